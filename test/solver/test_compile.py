"""Compiling: what is compiled, when it is loaded instead, in several threads and processes, and what a person reads."""

import ctypes
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import compiled_helpers as helpers
import numba
import numpy as np
import pytest
from compiled_helpers import doubled
from numba.core import typed_passes, untyped_passes

from sma_sim import Config, Effect, Input, Model, Parameter, module_input, simulate
from sma_sim.cli.main import main
from sma_sim.compiler.by_reference import is_large, size_of
from sma_sim.compiler.compile import (
    OUT_OF_LINE,
    Compiler,
    cache_folder,
    carray,
    code_of,
    content_key,
    first_lines_of,
    is_compiled,
    package_compiler,
    reachable,
    user_cache,
    write_source,
)
from sma_sim.compiler.fragments import ENTRY, FRAGMENT, NOT_NEEDED, on_compiled
from sma_sim.compiler.pinned_systems import pin_system, pinned_systems, record_at
from sma_sim.model.effects.ports import call_kernel
from sma_sim.solver import first_start
from sma_sim.solver.fixed_rate import FixedRateRun
from sma_sim.solver.integrate import integrate, integrate_held

ROOT = Path(__file__).resolve().parents[2]
# A function with large records, one inside the other, that calls another with a constant and with a number.
USER = """
import json, sys
from typing import NamedTuple
import numpy as np

class Inner(NamedTuple):
    a: float
    b: float
    c: float
    d: float
    e: np.ndarray
    f: float
    g: float
    h: float
    i: int

class Outer(NamedTuple):
    flag: bool
    inner: Inner
    table: np.ndarray

def part(k, outer, other):
    return outer.inner.e[k] * outer.inner.i + outer.table[k, 1] + (other.b if outer.flag else 0.0)

def whole(k, outer, out):
    out[0] = part(k, outer, outer.inner)
    out[1] = part(1, outer, outer.inner)
    return outer.inner.h

def main():
    from sma_sim.compiler.compile import Compiler
    inner = Inner(1.0, 2.0, 3.0, 4.0, np.arange(5.0), 6.0, 7.0, 8.0, 9)
    outer, out = Outer(True, inner, np.arange(6.0).reshape(3, 2)), np.zeros(2)
    compiler = Compiler('key', ('user',))
    entry = compiler.function(whole)
    result = entry(2, outer, out)
    versions = [len(fragment.overloads) for fragment in compiler._fragments.values()]
    hits = sum(entry.stats.cache_hits.values())
    print(json.dumps([result, *out, whole(2, outer, out), *out, hits, max(versions)]))
"""


class Small(NamedTuple):
    a: float
    b: float


class Large(NamedTuple):
    flag: bool
    small: Small
    table: np.ndarray
    more: tuple[float, float, float, float, float]
    count: int


class Larger(NamedTuple):
    large: Large
    factor: float


def in_part(k, one, small):
    return one.table[k, 1] * one.count + small.b + one.more[k] if one.flag else 0.0


def in_whole(k, both, out):
    out[0] = in_part(k, both.large, both.large.small)
    out[1] = helpers.doubled(in_part(1, both.large, both.large.small))
    return both.factor * both.large.small.a


def called_and_kept(native, numbers, kept, like, out):
    at = numbers.ctypes.data
    call_kernel(native, at, at + 8, at + 16, at + 24, out.ctypes.data)
    both = record_at(kept[1], like)
    out[2] = both.factor * both.large.table[2, 1] * both.large.count + in_part(
        1, record_at(kept[0], like).large, like.large.small
    )


def sum_of_others(a, b, c, d, out):
    written = carray(out, 2)
    written[0] = 1000.0 * carray(a, 1)[0] + 100.0 * carray(b, 1)[0] + 10.0 * carray(c, 1)[0] + carray(d, 1)[0]
    written[1] = doubled(carray(a, 2)[1])


def five_addresses(a, b, c, d, out):
    written = carray(out, 2)
    written[1] = doubled(carray(a, 2)[1])


@pytest.fixture
def started(tmp_path):
    """Start the user's program with a cache of its own; its process."""
    (tmp_path / 'user.py').write_text(USER, encoding='utf-8')
    environment = os.environ | {'XDG_CACHE_HOME': str(tmp_path / 'cache'), 'PYTHONPATH': f'{ROOT}{os.pathsep}{tmp_path}'}

    def start(module='user'):
        words = [sys.executable, '-c', f'import {module}; {module}.main()']
        return subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True)

    return start


def result_of(process):
    output = process.communicate(timeout=120)[0]
    assert process.returncode == 0
    return json.loads(output)


def test_passes_that_are_left_out_are_those_of_the_compiler():
    assert all(hasattr(untyped_passes, name) or hasattr(typed_passes, name) for name in NOT_NEEDED)


def test_processes_that_start_at_once_share_a_cache(started):
    """Each computes what Python computes, with one version of each function; later ones load what was compiled."""
    for process in [started() for _ in range(2)]:
        *values, _, versions = result_of(process)
        assert values[:3] == values[3:] == [8.0, 25.0, 14.0] and versions <= 1
    assert result_of(started())[-2:] == [1, 0]


def test_code_that_a_program_kept_which_is_gone_is_compiled_again(started, tmp_path):
    """Another program with the same text cannot load it, since it names types of the first one's module."""
    first = result_of(started())
    (tmp_path / 'user.py').unlink()
    (tmp_path / 'other.py').write_text(USER.replace("'user'", "'other'"), encoding='utf-8')
    for hits in (0, 1):
        *values, found, _ = result_of(started('other'))
        assert values == first[:-2] and found == hits


def test_records_of_any_size_go_to_compiled_functions(tmp_path, monkeypatch):
    """In this process, with the compiler switched on: large and small records, helpers in another module, a C function."""
    monkeypatch.setattr(numba.config, 'DISABLE_JIT', 0)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    one = Larger(Large(True, Small(1.5, 2.5), np.arange(8.0).reshape(4, 2), (1.0, 2.0, 3.0, 4.0, 5.0), 7), 3.0)
    numbers_in = numba.typeof(one)
    assert size_of(numbers_in) == 11 and is_large(numbers_in) and not is_large(numbers_in[0][1])
    made, work = Compiler('own', (__name__, helpers.__name__)), []
    on_compiled.append(work.append)
    try:
        out, expected = np.zeros(2), np.zeros(2)
        assert made.function(in_whole)(3, one, out) == in_whole(3, one, expected) == 4.5
        assert out.tolist() == expected.tolist() == [7 * 7 + 2.5 + 4.0, 2.0 * (3 * 7 + 2.5 + 2.0)]
        assert made.function(in_whole)(3, one._replace(large=one.large._replace(flag=False)), out) == 4.5 and not out.any()
    finally:
        on_compiled.remove(work.append)
    assert sorted(work) == [FRAGMENT] * 3 + [ENTRY]  # the entry, and once each what it calls
    native, numbers = made.native(five_addresses, doubled), np.array([3.0, 4.0, 0.0, 0.0])
    pointers = [ctypes.c_void_p(numbers[k:].ctypes.data) for k in (0, 0, 0, 0, 2)]
    ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)(native.address)(*pointers)
    assert numbers.tolist() == [3.0, 4.0, 0.0, 8.0]


def test_kept_code_is_linked_with_what_is_compiled_later(tmp_path, monkeypatch):
    """Its bitcode is read for that alone."""
    monkeypatch.setattr(numba.config, 'DISABLE_JIT', 0)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    for hits in (0, 1):
        kept = Compiler('own', (helpers.__name__,)).function(doubled)
        assert kept(2.0) == 4.0 and sum(kept.stats.cache_hits.values()) == hits
    (library,) = (one.library for one in kept.overloads.values())
    assert library._shared_module is None
    assert numba.njit(lambda x: kept(x) + 1.0)(3.0) == 7.0 and library._shared_module is not None


def test_compiled_code_calls_by_address_and_reads_kept_records(tmp_path, monkeypatch):
    """As plain Python does it, which keeps objects in place of copies."""
    monkeypatch.setattr(numba.config, 'DISABLE_JIT', 0)
    monkeypatch.setenv('NUMBA_DISABLE_JIT', '0')  # which numba reads again when it has changed
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    table = np.arange(8.0).reshape(4, 2)
    first = Larger(Large(True, Small(1.5, 2.5), table, (1.0, 2.0, 3.0, 4.0, 5.0), 7), 3.0)
    second = first._replace(factor=0.5, large=first.large._replace(table=2.0 * table, count=11))
    made, numbers = Compiler('own', (__name__, helpers.__name__, 'sma_sim.')), np.array([1.0, 2.0, 3.0, 4.0])
    native = made.native(sum_of_others, doubled)
    kept = pinned_systems([first, second, None, first], made.function(pin_system), False)
    assert kept.addresses[2] == 0 and kept.addresses[3] == kept.addresses[0] and len(set(kept.addresses.tolist())) == 3
    for like in (first, second):
        out = np.zeros(3)
        made.function(called_and_kept)(native.address, numbers, kept.addresses, like, out)
        assert out.tolist() == [1234.0, 4.0, 0.5 * 10.0 * 11 + 3.0 * 7 + 2.5 + 2.0]
    plain = pinned_systems([first, second, None], None, True)
    assert record_at(plain.addresses[1], first) is second and plain.addresses[2] == 0


def test_what_is_compiled_is_known_before_it_is_loaded(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, 'DISABLE_JIT', 0)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    assert not is_compiled()
    kept = cache_folder(content_key()) / '__pycache__'
    kept.mkdir()
    (kept / 'start.start-1.py311.nbi').write_text('')
    assert is_compiled() and kept.is_relative_to(tmp_path)
    monkeypatch.setattr(numba.config, 'DISABLE_JIT', 1)
    assert is_compiled()
    monkeypatch.setenv('XDG_CACHE_HOME', str(kept / 'start.start-1.py311.nbi'))  # a file, in which there is no folder
    assert cache_folder('key').is_relative_to(tempfile.gettempdir())


def test_the_first_lines_of_an_error_say_what_is_wrong():
    said = 'Failed in nopython mode\n\nNo implementation of f\n  File "a.py", line 3:\n^^^\nfor x\nhere\nthere\n'
    assert first_lines_of(ValueError(said)) == 'No implementation of f for x here'
    assert first_lines_of(ValueError('')) == 'ValueError'


def test_threads_do_not_take_each_others_cache_folder(tmp_path, monkeypatch):
    """numba's cache folder is a setting of the whole process: compilers at work at once must not see each other's."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    compilers, before = [Compiler(f'key{k}') for k in range(8)], numba.config.CACHE_DIR
    with ThreadPoolExecutor(8) as threads:
        entries = list(threads.map(lambda compiler: compiler.function(doubled), compilers))
    for compiler, entry in zip(compilers, entries, strict=True):
        assert entry.stats.cache_path.startswith(str(compiler.folder))
    assert before == numba.config.CACHE_DIR


@pytest.mark.parametrize(('platform', 'folder'), [('win32', 'AppData'), ('darwin', 'Library'), ('linux', '.cache')])
def test_cache_of_the_user_by_operating_system(monkeypatch, tmp_path, platform, folder):
    for name in ('XDG_CACHE_HOME', 'LOCALAPPDATA'):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, 'home', lambda: tmp_path)
    monkeypatch.setattr(sys, 'platform', platform)
    assert user_cache().relative_to(tmp_path).parts[0] == folder and user_cache().name == 'sma_sim'
    monkeypatch.setenv('LOCALAPPDATA' if platform == 'win32' else 'XDG_CACHE_HOME', str(tmp_path / 'own'))
    assert user_cache() == tmp_path / 'own' / 'sma_sim'


def test_another_source_is_compiled_anew(tmp_path):
    file = tmp_path / 'effect.py'
    keys = set()
    for text in ('a = 1\n', 'a = 2\n', 'a = 1\n'):
        file.write_text(text, encoding='utf-8')
        keys.add(content_key(file))
    assert len(keys) == 2 and content_key() not in keys


USES = {
    'default': 'def kernel(s, w, p, c=c): return -c * p.k * (s.T - s.T_E)',
    'global': 'def kernel(s, w, p): return -c * p.k * (s.T - s.T_E)',
    'array': 'def kernel(s, w, p): return -a[1] * p.k * (s.T - s.T_E)',
    'module': 'def kernel(s, w, p): return -m.c * p.k * (s.T - s.T_E)',
    'function': 'def inner(x): return c * x\ndef kernel(s, w, p): return -inner(p.k * (s.T - s.T_E))',
    'inner function': 'def kernel(s, w, p): return -(lambda x: c * x)(p.k * (s.T - s.T_E))',
}


def kernel_with(c, use, module='notebook'):
    namespace = {'c': c, 'a': np.array([0.0, c]), 'm': ModuleType('constants'), '__name__': module}
    namespace['m'].c = c
    exec(USES[use], namespace)
    return namespace['kernel']


@pytest.mark.parametrize('use', USES)
def test_code_of_a_kernel_tells_what_it_uses(use):
    assert code_of(kernel_with(1.0, use)) == code_of(kernel_with(1.0, use)) != code_of(kernel_with(10.0, use))


def test_a_kernel_has_what_it_uses_as_it_is_at_each_run():
    """Also where it was compiled with other values, in this program or before, and where it belongs to no module."""
    command, k = module_input([0.0, 4.0], [10.0, 10.0]), Parameter('k', 2e-3, 'W/K', (0.0, 1.0), 'loss', neutral=0.0)

    def warmth(kernel):
        loss = Effect(name='loss', port='wire_heat', equation='Q', source='a test', parameters=(k,), kernel=kernel)
        return [simulate(Model(Config(effects=[loss()])), command, 2.0)['T_1_K'][-1] for _ in later(kernel)]

    def later(kernel):
        yield
        kernel.__globals__['c'] = 10.0
        yield

    little, much = (warmth(kernel_with(c, 'default', None))[0] for c in (1.0, 10.0))
    assert little > much + 5.0
    assert warmth(kernel_with(1.0, 'global')) == [little, much]


def test_sources_of_native_code_keep_their_time(tmp_path):
    """numba compiles again when the time changes, as it would when two processes write the same text."""
    file = tmp_path / 'source.py'
    write_source(file, 'a = 1\n')
    first = file.stat().st_mtime_ns
    file.unlink()
    write_source(file, 'a = 1\n')
    assert file.stat().st_mtime_ns == first and file.read_text(encoding='utf-8') == 'a = 1\n'
    assert list(tmp_path.iterdir()) == [file]


def test_functions_out_of_line_exist():
    compiled = {
        python.__name__ for python in reachable(*first_start.SIMULATION, *first_start.FIXED_RATE, *first_start.TANGENTS)
    }
    assert set(OUT_OF_LINE) <= compiled


def test_a_person_reads_how_long_the_first_start_takes(monkeypatch):
    lines, now = [], [100.0]
    monkeypatch.setattr(first_start, 'is_compiled', lambda: False)
    monkeypatch.setattr(first_start.time, 'monotonic', lambda: now[0])
    first_start.announce_compilation(lines.append)
    first_start.announce_compilation(lines.append)
    assert lines == [first_start.STARTING] and len(on_compiled) == 1
    total = first_start.FRAGMENT * len(reachable(*first_start.SIMULATION)) + 2 * first_start.ENTRY
    for _ in range(total):
        now[0] += 0.5
        for call in list(on_compiled):
            call(1)
    assert lines[1] == f'compiling the equations: about {0.5 * (total - 10):.0f} s on this machine'
    assert 'done, about' in lines[2] and lines[-1] == f'compiled in {0.5 * total:.0f} s' and not on_compiled
    assert 4 <= len(lines) <= 7


def awkward(entries):
    """The same numbers as whole ones, not beside each other, not to be written to."""
    made = np.repeat(np.asfortranarray(np.array(entries, dtype=int)), 2, axis=-1)[..., ::2]
    made.setflags(write=False)
    return made


def test_whole_numbers_and_other_layouts_of_arrays_compile_nothing_more():
    """Another type of an argument would be half a minute of compiling in the middle of somebody's program."""
    versions = []
    for number, array in ((float, np.array), (int, awkward)):
        source = Input(array([0, 1, 2]), array([[5, 298], [0, 298], [0, 298]]), (False, False))
        run = simulate(Model(), source, array([0, 1, 2]), max_step=number(1), max_steps=number(1000))
        fixed = FixedRateRun(Model(), number(1000), array([0, 298]))
        fixed.step(array([5, 298]), 2)
        entries = [package_compiler().function(function) for function in (integrate, integrate_held)]
        versions.append([getattr(entry, 'signatures', []) for entry in entries] + [run['T_1_K'][-1], fixed.sample.tolist()])
    assert versions[0] == versions[1]


def test_compile_leaves_nothing_for_the_first_start(capsys):
    """Here it has been done; with an empty cache see below."""
    assert main(['compile']) == 0
    said = capsys.readouterr()
    assert 'native code is in' in said.out or 'Nothing is compiled' in said.out


OF_NODES = """
import sma_sim
from sma_sim.control import PredictiveController
from sma_sim.observer import Observer
from sma_sim.solver.warm_up import compile_fixed_rate

compile_fixed_rate()
Observer(sma_sim.Config()).update(0.0, 1.0, {'alpha': 0.0})
PredictiveController(sma_sim.Config()).step(0.0, {'alpha': 0.0}, lambda times: 0.0 * times)
"""


@pytest.mark.slow
def test_nothing_is_compiled_after_compile(tmp_path):
    environment = os.environ | {'XDG_CACHE_HOME': str(tmp_path)}
    words = [sys.executable, '-m', 'sma_sim.cli.main', 'compile']
    first, second = (
        subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=True) for _ in range(2)
    )
    assert 'compiling' in first.stderr and str(tmp_path) in first.stdout and second.stderr == ''
    files = sorted(tmp_path.rglob('*.nb?'))
    subprocess.run([sys.executable, '-c', OF_NODES], cwd=ROOT, env=environment, check=True)
    assert files and sorted(tmp_path.rglob('*.nb?')) == files
