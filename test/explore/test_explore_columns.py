"""Columns with other names and units than ours, chosen on the page of `sma-sim explore`."""

import json

import numpy as np
import pytest
from explore_server import refused, serving, until, verb
from explore_steps import begin, ended, gravity_case, opened

from sma_sim.evidence.data.sources import COLUMNS_BY_SYSTEM
from sma_sim.evidence.data.tables import read_columns, write_columns
from sma_sim.explore.columns import UNITS, choices, guess, map_text, meaning_of, unit_of
from sma_sim.model.structures.discovery import known_structures
from sma_sim.workflow.data_request import DataRequest

FOREIGN = {  # of the columns of a module: name, scale and offset to ours
    'time_s': ('t [ms]', 1e-3, 0.0),
    'J_eq_W': ('power_mW', 1e-3, 0.0),
    'T_E_K': ('room_C', 1.0, 273.15),
    'U_x_m': ('Ux (mm)', 1e-3, 0.0),
    'U_y_m': ('Uy (mm)', 1e-3, 0.0),
    'alpha_rad': ('angle_deg', np.pi / 180.0, 0.0),
    'F_1_N': ('pull_1', 1.0, 0.0),
}


@pytest.fixture(scope='module')
def case(tmp_path_factory):
    """Three runs in somebody's own columns, and the same in ours."""
    ours, theirs = gravity_case(tmp_path_factory), tmp_path_factory.mktemp('theirs')
    for file in sorted(ours.glob('*.csv')):
        found = read_columns(file, ('time_s', 'J_eq_W'), with_gaps=tuple(FOREIGN))
        found.setdefault('T_E_K', np.full(len(found['time_s']), 298.0))
        columns = {name: (found[our] - offset) / scale for our, (name, scale, offset) in FOREIGN.items() if our in found}
        write_columns(theirs / file.name, columns | {'note': np.zeros(len(found['time_s']))})
    (theirs / 'meta.json').write_text((ours / 'meta.json').read_text())
    return ours, theirs


@pytest.mark.parametrize(
    ('ours', 'header', 'column', 'unit'),
    [
        ('time_s', ['T1_degC', 't_ms'], 't_ms', 'ms'),
        ('T_1_K', ['t', 'T2 [°C]', 'T1 [°C]'], 'T1 [°C]', 'C'),
        ('J_W', ['power'], 'power', 'W'),
        ('J_eq_W', ['heating power [W]'], 'heating power [W]', 'W'),
        ('J_2_W', ['power_1', 'power_2'], 'power_2', 'W'),
        ('strain', ['strain_percent'], 'strain_percent', '%'),
        ('F_2_N', ['force 1', 'force 2'], 'force 2', 'N'),
        ('position_m', ['position [mm]', 'position_m'], 'position_m', 'm'),
        ('T_K', ['T_ambient_C', 'T_C'], 'T_C', 'C'),
        ('alpha_rad', ['force_N', 'torque'], '', 'rad'),
        ('time_s', ['time_N'], '', 's'),
        ('time_s', [], '', 's'),
    ],
)
def test_what_is_most_likely_is_proposed(ours, header, column, unit):
    assert guess(ours, header) == {'column': column, 'unit': unit, 'factor': 1.0}


def test_every_column_of_every_structure_has_a_meaning_and_units():
    for system, structure in known_structures().items():
        choices_of = [(name, meaning_of(name, system), UNITS[unit_of(name)]) for name in COLUMNS_BY_SYSTEM[system]]
        assert all(meaning and next(iter(units.values())) == (1.0, 0.0) for _, meaning, units in choices_of), structure.name
    assert meaning_of('F_2_N', 'module') == 'force of bundle 2' and meaning_of('J_eq_W', 'module') == 'electric power'


def test_choices_are_found_again_in_the_map_that_they_make(case, tmp_path):
    request = DataRequest((case[1],))
    chosen = {
        'time_s': {'column': 't [ms]', 'unit': 'ms', 'factor': 1.0},
        'T_1_K': {'column': 'room_C', 'unit': 'C', 'factor': 2.0},
        'J_eq_W': {'column': 'power_mW', 'unit': 'W', 'factor': -0.5},
    }
    (tmp_path / 'map.yaml').write_text(map_text(chosen, request, 'module'))
    again = {one['name']: one for one in choices(DataRequest((case[1],), map=tmp_path / 'map.yaml'), 'module')['ours']}
    for name, entry in chosen.items():
        assert {key: again[name][key] for key in entry} == pytest.approx(entry), name


@pytest.mark.parametrize(
    'line',
    [
        'J_eq_W: {value: 3.0}',
        'J_eq_W: {column: power_mW, exponent: 2}',
        'independent_after: 1.0',
        'sheet: Run 1',
        'columns: [a]',
    ],
)
def test_a_map_that_says_more_is_left_as_it_is(case, tmp_path, line):
    (tmp_path / 'map.yaml').write_text(f'time_s: t [ms]\n{line}\n')
    assert choices(DataRequest((case[1],), map=tmp_path / 'map.yaml'), 'module')['columns'] == []


@pytest.mark.slow
def test_columns_are_chosen_on_the_page(browser, case, tmp_path):
    """What was guessed is taken, one column is chosen by hand; the recordings are then those that our own columns give."""
    files = '\n'.join(str(case[1] / name) for name in ('run1.csv', 'run2.csv', 'run3.csv', 'meta.json'))
    with serving(tmp_path / 'session') as server:
        opened(browser, server)
        browser.find_element('id', 'view-data').click()
        browser.find_element('id', 'recordings-files').send_keys(files)
        begin(browser, 'check')
        ended(browser, 'check', 'failed')
        until(browser, 'return document.getElementById("use-columns") !== null')  # opened by itself
        pull = 'const one = document.querySelector("[data-column=F_1_N] select"); one.value = "pull_1";'
        browser.execute_script(f'{pull} document.getElementById("use-columns").click()')
        ended(browser, 'check')
        engine = server.application.data.engine
        config, data = server.application.session.config(), server.application.session.data
        found, expected = data.read(config), DataRequest((case[0],)).read(config)
        assert engine.latest('check').result()['noise_std'].keys() == {'U_x', 'U_y', 'alpha', 'F_1'}
        for one, other in zip(found.recordings, expected.recordings, strict=True):
            for name in ('U_x', 'U_y', 'alpha', 'F_1'):
                assert one.channels[name] == pytest.approx(other.channels[name], rel=1e-9, abs=1e-12), name
        assert data.map is not None and data.map.is_relative_to(server.application.session.folder)


def test_wrong_choices_change_nothing(case, tmp_path):
    with serving(tmp_path / 'session', data=DataRequest((case[1],))) as server:
        before = server.application.session.data
        good = {'time_s': {'column': 't [ms]', 'unit': 'ms'}, 'J_eq_W': {'column': 'power_mW', 'unit': 'mW'}}
        wrong = {'x': 1}, [], {}, {'time_s': good['time_s']}, good | {'evil_m': good['time_s']}, good | {'time_s': 3}
        further = {'unit': 'K'}, {'factor': 0.0}, {'factor': 'x'}, {'column': None}
        for columns in (*wrong, *(good | {'time_s': good['time_s'] | each} for each in further)):
            assert len(refused(server, 'choose_columns', columns=columns)) > 10, columns
        assert server.application.session.data == before
        assert json.loads(verb(server, 'columns')[1])['columns'][:2] == ['t [ms]', 'power_mW']
