"""The tour tells its story to the end, and leaves its reports."""

import json

import pytest

from sma_sim.cli.main import main
from sma_sim.model.config import read_config


@pytest.mark.slow
def test_the_tour(tmp_path, capsys):
    out = tmp_path / 'tour'
    assert main(['tour', '--out', str(out)]) == 0
    said = capsys.readouterr().out
    assert 'The verdict missing_effect is right' in said and 'sma_module_sim --ros-args --params-file' in said
    steps = json.loads((out / 'verdict.json').read_text())['error']
    assert steps[0]['held_out'] > 2.0 and steps[-1]['held_out'] < 1.15
    assert (out / 'error_fall.png').stat().st_size > 5000 and len(list(out.glob('*.html'))) == 4
    assert [active.effect.name for active in read_config(out / 'better.yaml').effects] == ['ambient_heating']
    assert main(['tour', '--out', str(out)]) == 2
