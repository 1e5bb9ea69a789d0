"""How the tests run together.

Where several run at a time (pytest -n 2), those of one file, and all that speak DDS, run one after the other.
"""

import signal

import pytest


def pytest_configure():
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as for a job in the background, and all that it starts
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(config, items):
    if config.pluginmanager.hasplugin('xdist'):
        for item in items:
            speaks = 'ros_client' in vars(item.module)
            item.add_marker(pytest.mark.xdist_group('dds' if speaks else item.path.name))
