"""How the tests run together.

What is compiled is compiled once, before workers start. Files are handed out whole, so that what a file's tests share
is made once: those that compute for long first, those that wait for a node between them.

Of those that speak DDS one that fails gets a second try, which the summary counts: messages of two topics may overtake
each other, and discovery takes as long as it takes.
"""

import signal

import hypothesis
import pytest
from prewarm import prewarm

# A busy machine draws slowly, and a first call may compile: neither is a fault of what is tested.
hypothesis.settings.register_profile('any machine', deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile('any machine')

# Files that take ten seconds and more of a processor, the longest first; those that compute in turns with those that mostly
# wait: with a worker more than there are processors, one waits while the others compute.
FIRST = (
    'test_next', 'test_docs', 'test_model_check', 'test_equations', 'test_controller', 'test_diagnose', 'test_latent',
    'test_recorder', 'test_diagnose_stop', 'test_node', 'test_calibrate', 'test_launch', 'test_fit_command', 'test_clock',
    'test_inseparable', 'test_node_control', 'test_diagnose_data', 'test_challenge', 'test_trajectory', 'test_two_effects',
    'test_report_html', 'test_stages', 'test_explore_recordings',
    'test_wrong_use', 'test_compare', 'test_optional_packages', 'test_install',
    'test_interpreted',
)  # fmt: skip


def pytest_configure(config):
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as for a job in the background, and all that it starts
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if config.getoption('numprocesses', None):  # and a worker has none itself
        prewarm()


def pytest_collection_modifyitems(config, items):
    rank = {name: k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(rank)))
    if config.pluginmanager.hasplugin('rerunfailures'):
        for item in items:
            if 'ros_client' in vars(item.module):
                item.add_marker(pytest.mark.flaky(reruns=1))
