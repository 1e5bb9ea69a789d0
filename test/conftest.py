"""How the tests run together.

What is compiled is compiled once, before workers start. Files are handed out whole, so that what a file's tests share
is made once: the longest first, those that wait for a node between those that compute.

Of those that speak DDS one that fails gets a second try, which the summary counts: messages of two topics may overtake
each other, and discovery takes as long as it takes.
"""

import ctypes
import os
import signal
import sys
from pathlib import Path

# Tests share what others define, in rooms beside their own.
sys.path += [str(room) for room in Path(__file__).parent.iterdir() if any(room.glob('*.py'))]
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # before NumPy: its threads would fight with those of other workers

import hypothesis  # noqa: E402
import numba  # noqa: E402
import pytest  # noqa: E402
from browser import silent_browser  # noqa: E402
from prewarm import prewarm  # noqa: E402

# A busy machine draws slowly, and a first call may compile: neither is a fault of what is tested.
hypothesis.settings.register_profile('any machine', deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile('any machine')

# Files that take twenty seconds and more, the longest first; those that mostly wait in turns with those that compute: with
# more than twice as many workers as processors, some of them wait while the others compute.
FIRST = (
    'test_last_command',
    'test_live_diagnosis',
    'test_diagnose',
    'test_set_up',
    'test_model_check',
    'test_explore_recordings',
    'test_observer_node',
    'test_stages',
    'test_equations',
    'test_node',
    'test_gallery',
    'test_report_html',
    'test_controller_node',
    'test_control',
    'test_notebook_api',
    'test_explore_page',
    'test_clock',
    'test_latent',
    'test_optional_packages',
    'test_next',
    'test_recorder',
    'test_diagnose_data',
    'test_observer',
    'test_variants',
    'test_untrusted_data',
    'test_controller',
    'test_calibrate',
    'test_bags_of_structures',
    'test_bags',
    'test_fit_command',
    'test_explore_focus',
    'test_node_control',
    'test_inseparable',
    'test_kinetics',
    'test_cases_of_benchmarks',
    'test_explore_layout',
    'test_guard_node',
    'test_diagnose_stop',
    'test_plot',
    'test_examples',
    'test_player',
    'test_differing_recordings',
    'test_structures',
    'test_portable',
    'test_structure_nodes',
    'test_explore_files',
    'test_cycles',
    'test_trajectory',
    'test_stack',
    'test_characterization',
)


@pytest.fixture(scope='module')
def browser():
    """A browser for the tests of a file, which must leave no error in its console."""
    with silent_browser() as one:
        yield one


def pytest_configure(config):
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as for a job in the background, and all that it starts
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if config.getoption('numprocesses', None):  # and a worker has none itself
        os.environ.pop('PYTHONDONTWRITEBYTECODE', None)  # hundreds of processes start: each would read all sources anew
        prewarm()


def pytest_collection_modifyitems(config, items):
    rank = {name: k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(rank)))
    if config.pluginmanager.hasplugin('rerunfailures'):
        for item in items:
            if 'ros_client' in vars(item.module):
                item.add_marker(pytest.mark.flaky(reruns=1))


@pytest.fixture
def interpreted(monkeypatch):
    """Call a function with numba switched off; models that it makes are plain Python too."""
    from sma_sim.compiler import effect_kernels, structure_kernels

    kept = []  # the addresses of its functions are in use

    def uncached(native):
        def build(*found):
            kept.append(native.__wrapped__(*found))
            return kept[-1]

        return build

    def numbers_at(pointer, size):
        """What numba's own `carray` gives as plain Python, which takes most of the time of a run."""
        return (ctypes.c_double * size).from_address(ctypes.addressof(pointer.contents))

    def run(function, *arguments):
        with monkeypatch.context() as patch:
            patch.setattr(numba.config, 'DISABLE_JIT', True)
            patch.setattr(effect_kernels, 'carray', numbers_at)
            patch.setattr(structure_kernels, 'carray', numbers_at)
            patch.setattr(effect_kernels, '_native_effect', uncached(effect_kernels._native_effect))
            patch.setattr(structure_kernels, '_native_structure', uncached(structure_kernels._native_structure))
            return function(*arguments)

    return run
