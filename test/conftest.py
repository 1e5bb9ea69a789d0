"""Where several tests run at a time (pytest -n 2), those of one file, and all that speak DDS, run one after the other."""

import pytest


def pytest_collection_modifyitems(config, items):
    if config.pluginmanager.hasplugin('xdist'):
        for item in items:
            speaks = 'ros_client' in vars(item.module)
            item.add_marker(pytest.mark.xdist_group('dds' if speaks else item.path.name))
