"""Arguments against annotations: what is taken, what is refused, and in which words."""

import copy
import pickle
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest

from sma_sim import Config, Dataset, FitOptions, Recording, UserError, module_input, simulate
from sma_sim.model.argument_checks import as_array, as_folders, as_kelvin, check_fields, checked, expect, is_like
from sma_sim.model.frozen import own_array

Vector = np.typing.NDArray[np.float64]
Pair = tuple[float, float]


class Stop(Protocol):
    def is_set(self) -> bool: ...


class Submits:
    def submit(self): ...


FITS = [
    (2, float),
    (np.float32(2.0), float),
    (np.int64(2), int),
    (np.True_, bool),
    ('a', str),
    (Path('a'), str | Path),
    ('a', Path),
    (None, float | None),
    ((1.0, 2), Pair),
    ([1.0, 2.0], Pair),
    ((), tuple[str, ...]),
    (('a', 'b'), tuple[str, ...]),
    (['a'], Sequence[str]),
    ([], Collection[str]),
    ((name for name in 'ab'), Iterable[str]),
    (np.zeros(3), Sequence[float]),
    ([1.0, 'x'], Sequence[float]),  # said where an array is made of it
    ([1.0], Vector),
    ({'a': 1.0}, Mapping[str, float]),
    ({'a': (1.0, 2.0)}, Mapping[str, Pair]),
    ({}, Mapping[str, Any]),
    (len, Callable[[str], int]),
    (len, Callable | None),
    (Submits(), Executor),
    (object(), Stop),
    (Config(), Config),
    (object(), Any),
]
WRONG = [
    ('2', float, 'a number'),
    (True, float, 'a number'),
    (2.0, int, 'a whole number'),
    (True, int, 'a whole number'),
    (1, bool, 'True or False'),
    (3, str, 'a text'),
    (3, str | Path | None, 'a text or a path'),
    (None, float, 'a number'),
    ((1.0,), Pair, r'\(a number, a number\)'),
    ((1.0, 'x'), Pair, r'\(a number, a number\)'),
    ('ab', Pair, r'\(a number, a number\)'),
    ('ab', Sequence[str], 'a list of text'),
    (3, Sequence[str], 'a list of text'),
    (['a', 3], tuple[str, ...], 'a list of text'),
    ('12', Sequence[float], 'a list of number'),
    (None, Vector, 'numbers'),
    ({'a': 'x'}, Mapping[str, float], 'a mapping from a text to a number'),
    ({1: 1.0}, Mapping[str, float], 'a mapping from a text to a number'),
    ([('a', 1.0)], Mapping[str, float], 'a mapping from a text to a number'),
    (3, Callable[[str], int], 'a function'),
    (3, Executor | None, r'an executor such as ThreadPoolExecutor\(\)'),
    ({'beam.E': 2e9}, Config, r'Config, from sma_sim.Config\(...\) or read_config\(...\)'),
]


@pytest.mark.parametrize(('value', 'hint'), FITS)
def test_what_fits_an_annotation(value, hint):
    assert is_like(value, hint)
    expect('x', value, hint)


@pytest.mark.parametrize(('value', 'hint', 'words'), WRONG)
def test_what_does_not_is_said(value, hint, words):
    with pytest.raises(UserError, match=f'^x: expected {words}; got '):
        expect('x', value, hint)


def test_what_was_given_is_shown_where_it_is_short():
    for value, words in ((None, 'None'), ('a', "'a'"), ([3], r'\[3\]'), ('a' * 61, 'str'), (np.zeros(2), 'ndarray')):
        with pytest.raises(UserError, match=f'got {words}$'):
            expect('x', value, float)


@dataclass(frozen=True)
class Request:
    name: str
    limits: 'Mapping[str, tuple[float, float]]'

    def __post_init__(self):
        check_fields(self)


@checked
def area(width: float, unit: str = 'm') -> float:
    return width


def test_functions_and_records_are_checked():
    assert area(2.0) == 2.0 and area(width=3, unit='mm') == 3 and area.__name__ == 'area'
    with pytest.raises(UserError, match="width: expected a number; got '2'"):
        area('2')
    with pytest.raises(UserError, match='unit: expected a text; got 2'):
        area(1.0, unit=2)
    with pytest.raises(TypeError, match=r'area\(\) missing 1 required positional argument'):
        area()
    assert Request('a', {'b': (0.0, 1.0)}).name == 'a'
    with pytest.raises(UserError, match='limits: expected a mapping from a text to'):
        Request('a', {'b': 1.0})


def test_folders_and_kelvin():
    assert as_folders('x', 'a') == as_folders('x', [Path('a')]) == as_folders('x', (name for name in 'a')) == [Path('a')]
    assert as_kelvin('T_E', 298.0) == 298.0 and as_kelvin('T_E', 150.0) == 150.0
    for wrong, words in ((25.0, '\n25 deg C are 298.15 K$'), (3000.0, 'between 150 and 2000$'), ('298', "got '298'$")):
        with pytest.raises(UserError, match=words):
            as_kelvin('T_E', wrong)
    with ThreadPoolExecutor(1) as pool:
        expect('executor', pool, Executor | None)


def test_what_is_masked_is_missing():
    """NumPy itself takes the number behind the mask: a fit would follow values that its user has ruled out."""
    masked = np.ma.masked_array([1, 900, 3], [False, True, False])
    assert np.array_equal(as_array('x', masked), [1.0, np.nan, 3.0], equal_nan=True) and masked.data[1] == 900
    time = np.arange(3.0)
    command = module_input([0.0, 2.0], [0.0, 0.0])
    shown = Recording('a', 'module', time, {'alpha': np.ma.masked_array([0.0, 9.0, 0.0], time == 1.0)}, command)
    assert np.isnan(shown.channels['alpha']).tolist() == [False, True, False]
    with pytest.raises(UserError, match='must be finite'):
        module_input([0.0, 1.0, 2.0], masked)


DATES = np.array(['2026-01-01', '2026-01-02'], 'datetime64[ns]')


@pytest.mark.parametrize(
    ('value', 'words'),
    [
        (DATES, r"got datetime64\[ns\]; for seconds write \(t - t\[0\]\) / numpy.timedelta64\(1, 's'\)$"),
        (DATES - DATES[0], r"got timedelta64\[ns\]; for seconds write t / numpy.timedelta64\(1, 's'\)$"),
        (np.array([1.0, 2.0j]), 'got ndarray$'),
        ([1.0, 2.0j], r'got \[1.0, 2j\]$'),
    ],
)
def test_what_numpy_would_make_other_numbers_of_is_refused(value, words):
    with pytest.raises(UserError, match=f'x: expected numbers, {words}'):
        as_array('x', value)


def test_what_was_checked_stays_so():
    """Callers use their arrays and dicts again: what a record was made of may change."""
    times, time, alpha, noise = np.array([0.0, 2.0]), np.arange(3.0), np.zeros(3), {'alpha': 1e-3}
    channels, stds, limits = {'alpha': alpha}, {'alpha': 0.1}, {'beam.E': [1e9, 3e9]}
    command = module_input(times, [0.0, 0.0])
    recording = Recording('a', 'module', time, channels, command, zero_std=stds)
    dataset, options = Dataset(recording, noise), FitOptions(limits=limits)
    same = copy.deepcopy((command, dataset, options))
    times[0], time[1], alpha[0], noise['alpha'] = -1.0, 9.0, 9.0, 0.0
    channels['foo'], stds['alpha'], limits['beam.E'][0] = alpha, -1.0, 5e9
    assert (command, dataset, options) == same == pickle.loads(pickle.dumps(same))
    for array in (recording.time, recording.channels['alpha'], command.times, command.values):
        with pytest.raises(ValueError, match='read-only'):
            array[0] = 1.0
    with pytest.raises(TypeError):
        recording.channels['foo'] = alpha
    again = replace(recording, name='b')
    assert again.time is recording.time and again.channels['alpha'] is recording.channels['alpha']  # as fits make them


def test_a_view_of_what_may_change_is_copied():
    whole = np.zeros(4)
    view = whole[:2]
    view.flags.writeable = False
    assert own_array(view) is not view and own_array(own := own_array(whole)) is own and whole.flags.writeable
    assert own_array(own[1:]).base is own and own_array(np.broadcast_to(whole, (3, 4))).base is None


def test_iterators_are_read_once():
    for free in ((name for name in ['beam.E']), map(str, ['beam.E']), ['beam.E'], ('beam.E',)):
        assert FitOptions(free=free).names == ('beam.E',)
    run = simulate(Config(), module_input([0.0, 1.0], [0.0, 0.0]), 2.0, channels=(name for name in ['alpha']))
    assert list(run.columns) == ['alpha_rad']
    with pytest.raises(UserError, match="free: expected names .* got {'beam.E': 3000000000.0}"):
        FitOptions(free={'beam.E': 3e9})
