"""The docstrings of the public interface: examples run, every parameter is described."""

import doctest
import inspect
import re

import pytest

import sma_sim

FUNCTIONS = [name for name in sma_sim.__all__ if inspect.isfunction(getattr(sma_sim, name))]


@pytest.mark.parametrize('name', FUNCTIONS)
def test_example_runs(name):
    (found,) = doctest.DocTestFinder(recurse=False).find(getattr(sma_sim, name), name, globs={})
    assert found.examples, f'{name} has no example'
    runner = doctest.DocTestRunner()
    report = []
    runner.run(found, out=report.append)
    assert runner.failures == 0, ''.join(report)


@pytest.mark.parametrize('name', FUNCTIONS)
def test_sections_describe_the_signature(name):
    function = getattr(sma_sim, name)
    text = inspect.getdoc(function)
    parameters = re.search(r'Parameters\n-+\n(.*?)\n\n\w+\n-+\n', text, re.S)
    described = re.findall(r'^(\w+)(?: :|$)', parameters[1], re.M) if parameters else []
    assert described == list(inspect.signature(function).parameters)
    assert re.search(r'^Returns\n-+$', text, re.M)


def test_public_docstrings_have_sections():
    with_sections = [name for name in sma_sim.__all__ if re.search(r'\n-{4,}\n', inspect.getdoc(getattr(sma_sim, name)))]
    assert set(sma_sim.__all__) - set(with_sections) == {
        'EffectChoice',
        'EffectError',
        'NamedEffect',
        'PhysicsWarning',
        'SimulationError',
        'StructureError',
        'UserError',
        'CommandLimits',
        'Drive',
    }


def test_every_public_name_is_in_the_reference():
    from pathlib import Path

    page = (Path(__file__).resolve().parents[2] / 'docs' / 'reference' / 'api.md').read_text()
    assert [name for name in sma_sim.__all__ if not re.search(rf'auto\w+:: {name}$', page, re.M)] == []
