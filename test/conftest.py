"""How the tests run together.

Where several run at a time (pytest -n 2), those of one file, and all that speak DDS, run one after the other. Of the
latter, one that fails gets a second try, which the summary counts: messages of two topics may overtake each other, and
discovery takes as long as it takes.
"""

import signal

import pytest


def pytest_configure():
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as for a job in the background, and all that it starts
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(config, items):
    together, again = (config.pluginmanager.hasplugin(name) for name in ('xdist', 'rerunfailures'))
    for item in items:
        speaks = 'ros_client' in vars(item.module)
        if together:
            item.add_marker(pytest.mark.xdist_group('dds' if speaks else item.path.name))
        if again and speaks:
            item.add_marker(pytest.mark.flaky(reruns=1))
