"""What pyproject.toml cannot say: the files that pip must add so that `ros2 run` and `ros2 launch` find the package."""

import sys

import setuptools

PIP_COMMANDS = {'sdist', 'bdist_wheel', 'editable_wheel'}  # colcon runs others and puts the commands there itself


class Distribution(setuptools.Distribution):
    """One with executables where ROS looks for them, and whose data files belong to an editable installation too."""

    def parse_config_files(self, *args, **kwargs):
        """Add the executables, where pip builds."""
        super().parse_config_files(*args, **kwargs)
        if PIP_COMMANDS & set(sys.argv):
            programs = ('sma_module_sim', 'sma_model_check', 'sma_observer', 'sma_guard', 'sma_controller')
            executables = [f'resource/run/{name}' for name in programs]
            self.data_files = [*(self.data_files or []), ('lib/sma_sim', executables)]

    def has_data(self):
        """What setuptools asks for when it makes an editable installation; distutils calls it `has_data_files`."""
        return self.has_data_files()


dist = setuptools.setup(distclass=Distribution)
if dist.python_requires is not None:  # colcon reads this object back with ast.literal_eval
    dist.python_requires = dist.metadata.python_requires = str(dist.python_requires)
