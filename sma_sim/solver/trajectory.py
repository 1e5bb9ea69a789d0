"""A run: its samples by the names of the file contract, and what a notebook makes of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, NamedTuple

from sma_sim.model.archive import Saved
from sma_sim.model.argument_checks import checked
from sma_sim.model.arrays import Vector
from sma_sim.model.comparable import Comparable
from sma_sim.model.errors import UserError
from sma_sim.model.nearest import UnknownNameError, suggestion
from sma_sim.model.optional import require
from sma_sim.model.shown import Shown, listed, text_table
from sma_sim.solver.integrate import Run

FIGURES = 'sma_sim.report.run_figure'  # a room above this one: only who draws needs it


class Jump(NamedTuple):
    """One jump of the hybrid-time log: at (t, j) wire `wire` left mode `source` for `target` through `guard`."""

    t: float
    j: int
    wire: int
    guard: str
    source: int
    target: int


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Shown, Saved, Comparable):
    """Samples of a run; ``trajectory['alpha_rad']`` is a column, whose unit is part of its name (`units`).

    Attributes
    ----------
    time : array (k,)
        Sample times [s].
    columns : dict
        Arrays (k,) by the column names of CSV files, SI units.
    jumps : tuple of Jump
        Mode changes of the hybrid automaton.
    reason, completed : str, bool
        Why the run ended, and whether that is the end of its input.
    steps, rejected, chattering : int
        Accepted and rejected steps; wires that were held in a mode to stop chattering.
    state, notes : Run, tuple of str
        Where the run ended, to continue from; remarks, for instance about a start that was moved.
    resistances : mapping
        Arrays (k,) of the wires' resistances [ohm] by column (``R_1_ohm``); a run has them, but not every file.
    inputs : mapping
        Arrays (k,) of the input in force by column (``J_eq_W``, ``T_E_K``); none where single channels were sampled.
    units : mapping
        The unit of every column, ``'-'`` for none.
    """

    time: Vector
    columns: dict[str, Vector]
    jumps: tuple[Jump, ...]
    reason: str
    completed: bool
    steps: int
    rejected: int
    chattering: int
    state: Run
    notes: tuple[str, ...] = ()
    resistances: Mapping[str, Vector] = field(default_factory=dict)
    inputs: Mapping[str, Vector] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def end(self) -> float:
        """Time of the last sample [s], NaN if there is none."""
        return float(self.time[-1]) if len(self.time) else float('nan')

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all columns: the input, what is sampled, resistances."""
        return tuple(dict.fromkeys((*self.inputs, *self.columns, *self.resistances)))

    def keys(self) -> tuple[str, ...]:
        """The names of all columns with that of time, as of a mapping: ``dict(trajectory)`` has their arrays."""
        return ('time_s', *self.names)

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __contains__(self, name: object) -> bool:
        return name in self.keys()

    def __getitem__(self, name: str) -> Vector:
        if name == 'time_s':
            return self.time
        for columns in (self.columns, self.inputs, self.resistances):
            if isinstance(name, str) and name in columns:
                return columns[name]
        if not isinstance(name, str):
            raise UserError(f"expected the name of a column, such as 'time_s', got {name!r}; to_dataframe() takes several")
        known = self.keys()
        raise UnknownNameError(f'no column {name!r}{suggestion(name, known)}; the columns are {", ".join(known)}')

    def facts(self) -> Mapping[str, str]:
        """What is to be known at a glance."""
        first = float(self.time[0]) if len(self.time) else float('nan')
        found = {'samples': f'{len(self.time)} from {first:g} to {self.end:g} s', 'columns': listed(self.names)}
        found |= {'mode changes': f'{len(self.jumps)}', 'end': self.reason}
        return found | ({'notes': '; '.join(self.notes)} if self.notes else {})

    def summary(self) -> str:
        """The range of every column with its unit, the mode changes and how the run ended, as text."""
        rows = [
            (name, *(f'{value:.6g}' for value in (v[0], v.min(), v.max(), v[-1])), self.units.get(name, ''))
            for name in self.names
            if len(v := self[name])
        ]
        words = [f'{name}: {text}' for name, text in self.facts().items() if name != 'columns']
        return '\n'.join([*words, '', text_table(('column', 'first', 'least', 'largest', 'last', 'unit'), rows)])

    @checked
    def plot(self, columns: str | Iterable[str] | None = None, title: str = '') -> Any:
        """The run as a figure: coordinates, temperatures, forces, fractions, modes and command over time.

        Parameters
        ----------
        columns : str or iterable of str, optional
            Draw these columns only.
        title : str
            Stands above the figure.

        Returns
        -------
        matplotlib.figure.Figure
            The figure, which a notebook shows; ``figure.savefig('run.png')`` writes it.

        Raises
        ------
        UserError
            For a column that the run does not have, or a run with fewer than two samples.
        """
        names = [columns] if isinstance(columns, str) else columns
        shown = [name for name in self.names if name not in self.resistances] if names is None else list(names)
        return import_module(FIGURES).draw_run({'time_s': self.time} | {name: self[name] for name in shown}, title)

    def to_dataframe(self) -> Any:
        """All columns as a pandas DataFrame over ``time_s``, with their units in ``attrs['units']``.

        Raises UserError where pandas is not installed.
        """
        pandas = require('pandas', 'a DataFrame')
        frame = pandas.DataFrame({name: self[name] for name in self.names}, index=pandas.Index(self.time, name='time_s'))
        frame.attrs['units'] = dict(self.units)
        return frame

    def to_xarray(self) -> Any:
        """All columns as an xarray Dataset along ``time_s``, each with its ``units``.

        Raises UserError where xarray is not installed.
        """
        xarray = require('xarray', 'a Dataset')
        data = {name: ('time_s', self[name], {'units': self.units.get(name, '')}) for name in self.names}
        time = ('time_s', self.time, {'units': 's'})
        return xarray.Dataset(data, coords={'time_s': time}, attrs={'reason': self.reason})
