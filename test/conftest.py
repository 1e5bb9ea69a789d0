"""How the tests run together.

Of those that speak DDS one that fails gets a second try, which the summary counts: messages of two topics may overtake
each other, and discovery takes as long as it takes.
"""

import signal

import pytest


def pytest_configure():
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as for a job in the background, and all that it starts
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(config, items):
    if config.pluginmanager.hasplugin('rerunfailures'):
        for item in items:
            if 'ros_client' in vars(item.module):
                item.add_marker(pytest.mark.flaky(reruns=1))
