"""Python programs that start for a quarter of the processor time: forks of a process that has imported what they import.

A node imports for a second and more before it does anything, and the tests start a hundred. `Program` stands in for
`subprocess.Popen`; each program has its own environment, folder, arguments and streams, and ends as one that was started
by itself. That programs start by themselves is what test_launch, test_install, test_optional_packages, test_node_arguments
and the tests of the commands see.
"""

import atexit
import contextlib
import importlib
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
from functools import cache
from pathlib import Path
from types import SimpleNamespace

ROOT = Path(__file__).resolve().parents[1]
IMPORTED = (
    'sma_sim.ros.node', 'sma_sim.ros.check_node', 'sma_sim.ros.parameter_node', 'sma_sim.ros.realtime',
    'sma_sim.ros.recording', 'sma_sim.ros.parameters', 'sma_sim.solver.warm_up', 'sma_sim.explore.work', 'rclpy.action',
    'rosidl_generator_py', 'rosbags.typesys.stores',
)  # fmt: skip
OF_THE_SERVER = ('NUMBA_', 'XDG_CACHE_HOME', 'RMW_IMPLEMENTATION', 'FASTRTPS_', 'FASTDDS_')  # it has read them
STREAMS = 3


def of_the_server(environment):
    """The variables that the server has read before it forks."""
    return {name: value for name, value in environment.items() if name.startswith(OF_THE_SERVER)}


@cache
def server():
    """The socket on which the server of this process takes requests, and the variables that it has read."""
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    words = [sys.executable, __file__, str(its.fileno())]
    silent = subprocess.DEVNULL
    environment = os.environ | {'PYTHONPATH': os.pathsep.join([str(ROOT), *filter(None, [os.environ.get('PYTHONPATH')])])}
    process = subprocess.Popen(words, pass_fds=[its.fileno()], stdin=silent, stdout=silent, cwd=ROOT, env=environment)
    its.close()
    atexit.register(process.wait)
    atexit.register(ours.close)  # before: it ends with the socket
    return ours, of_the_server(os.environ)


def started(words, cwd=None, env=None, stdout=None, stderr=None, start_new_session=False, stdin=None, text=True):
    """A Python program, `words` as for `subprocess.Popen`: a fork, or a process where its environment is another's."""
    environment = dict(os.environ if env is None else env)
    if words[1] == '-c' or of_the_server(environment) != server()[1]:
        return subprocess.Popen(words, cwd=cwd, env=environment, stdin=stdin, stdout=stdout, stderr=stderr, text=text,
                                start_new_session=start_new_session)  # fmt: skip
    return Program(words, cwd, environment, (stdout, stderr), start_new_session)


def ended(words, cwd=None, env=None, timeout=120):
    """What a Python program said and its exit code, as `subprocess.run` has them."""
    process = started(words, cwd, env, subprocess.PIPE, subprocess.PIPE)
    said = process.communicate(timeout=timeout)
    return subprocess.CompletedProcess(words, process.returncode, *said)


@contextlib.contextmanager
def forked_jobs():
    """The jobs of a session of `sma-sim explore` as forks."""
    from sma_sim.explore import jobs

    before = jobs.subprocess
    jobs.subprocess = SimpleNamespace(Popen=started, DEVNULL=subprocess.DEVNULL)
    try:
        yield
    finally:
        jobs.subprocess = before


class Program:
    """A started program."""

    def __init__(self, words, cwd, environment, outputs, start_new_session):
        self.args, self.returncode, self.stdin = words, None, None
        self._status, its_status = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._said, self._readers = [None, None], []
        self.stdout, out = opened(outputs[0], None)
        self.stderr, err = opened(outputs[1], out)
        folder = os.fspath(cwd or Path.cwd())
        request = {
            'words': list(map(str, words[1:])),
            'folder': folder,
            'environment': environment,
            'new': start_new_session,
        }
        request['new'] = start_new_session
        content = os.memfd_create('request')  # an environment may be longer than a packet
        os.write(content, json.dumps(request).encode())
        none = os.open(os.devnull, os.O_RDONLY)
        given = [its_status.fileno(), content, none, out, err]
        socket.send_fds(server()[0], [b'start'], given)
        for fd in {content, none, out, err} - {1, 2}:
            os.close(fd)
        its_status.close()
        self.pid = int(self._status.recv(64))

    def poll(self):
        """The exit code, None before the end."""
        if self.returncode is None and select.select([self._status], [], [], 0.0)[0]:
            self.returncode = int(self._status.recv(64) or -signal.SIGKILL)
            self._status.close()
        return self.returncode

    def wait(self, timeout=None):
        """The exit code, at its end."""
        if self.returncode is None and not select.select([self._status], [], [], timeout)[0]:
            raise subprocess.TimeoutExpired(self.args, timeout)
        return self.poll()

    def communicate(self, timeout=None):
        """All that it says on its pipes, at its end."""
        if not self._readers:
            for k, stream in enumerate((self.stdout, self.stderr)):
                self._readers.append(threading.Thread(target=self._read, args=(k, stream), daemon=True))
                self._readers[-1].start()
        for reader in self._readers:
            reader.join(timeout)
            if reader.is_alive():
                raise subprocess.TimeoutExpired(self.args, timeout)
        self.wait(timeout)
        return tuple(self._said)

    def _read(self, k, stream):
        if stream is not None:
            with stream:
                self._said[k] = stream.read()

    def send_signal(self, number):
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self):
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self):
        """End it."""
        self.send_signal(signal.SIGKILL)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for stream in (self.stdout, self.stderr):
            if stream is not None:
                stream.close()
        self.wait()


def opened(wanted, out):
    """The end of a stream that is read here, if any, and the file descriptor of the program's end."""
    if wanted == subprocess.PIPE:
        ours, its = os.pipe()
        return open(ours, encoding='utf-8', errors='replace'), its
    if wanted == subprocess.STDOUT:
        return None, os.dup(out)
    if wanted == subprocess.DEVNULL:
        return None, os.open(os.devnull, os.O_WRONLY)
    return None, os.dup(2 if wanted is None else wanted.fileno())


def serve(requests):
    """Start what is asked for until nobody can ask any more; returns in a program, with its words, or at the end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the programs
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for the keepers
    for name in IMPORTED:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    sys.modules['sma_sim.solver.warm_up'].compile_fixed_rate()
    while True:
        message, given, *_ = socket.recv_fds(requests, 16, 2 + STREAMS)
        if not message:
            return []
        if not os.fork():
            requests.close()
            return keep(socket.socket(fileno=given[0]), given[1], given[2:])
        for fd in given:
            os.close(fd)


def keep(status, content, streams):
    """In a fork: start a program and say how it ended; returns in the program, with its words."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    pid = os.fork()
    if not pid:
        status.close()
        return become(json.loads(os.pread(content, os.fstat(content).st_size, 0)), streams)
    for fd in streams:
        os.close(fd)
    with contextlib.suppress(OSError):  # who asked may have ended
        status.send(str(pid).encode())
        status.send(str(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])).encode())
    os._exit(0)


def become(request, streams):
    """In a fork of the fork: what a new process has of its own; the words of the program."""
    for k, fd in enumerate(streams):
        os.dup2(fd, k)
        os.close(fd)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if request['new']:
        os.setsid()
    os.environ.clear()
    os.environ.update(request['environment'])
    os.chdir(request['folder'])
    if os.environ.get('PYTHONUNBUFFERED'):
        sys.stdout.reconfigure(line_buffering=True)
    return request['words']


def run(words):
    """Run a program: `-m` and a module, or a file, then its arguments; its exit code."""
    try:
        if words[0] == '-m':
            sys.argv, sys.path[0] = words[1:], os.getcwd()
            runpy.run_module(words[1], run_name='__main__', alter_sys=True)
        else:
            sys.argv, sys.path[0] = words, str(Path(words[0]).resolve().parent)
            runpy.run_path(words[0], run_name='__main__')
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException as error:
        sys.excepthook(type(error), error, error.__traceback__)
        return 1
    return 0


def end(code):
    """End as Python does; what libraries in C do after it would wait for threads that only the server had."""
    threading._shutdown()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == '__main__':
    asked = serve(socket.socket(fileno=int(sys.argv[1])))
    if asked:
        end(run(asked))
