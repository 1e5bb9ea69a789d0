"""Lets colcon read the metadata of pyproject.toml."""

from setuptools import setup

dist = setup()
if dist.python_requires is not None:  # colcon reads this object back with ast.literal_eval
    dist.python_requires = dist.metadata.python_requires = str(dist.python_requires)
