"""Write docs/reference/parameters.md: parameters of the model, its structures and effects, and coordinates, as declared.

python docs/make_parameters.py
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import isfinite
from pathlib import Path

from sma_sim.model.effects.discovery import find_effects
from sma_sim.model.parameters import ENVIRONMENT_PARAMETERS, SOLVER_PARAMETERS, WIRE_PARAMETERS, Parameter
from sma_sim.model.program_parameters import (
    CHECK_PARAMETERS,
    CONTROL_PARAMETERS,
    GUARD_PARAMETERS,
    NODE_PARAMETERS,
    OBSERVER_PARAMETERS,
)
from sma_sim.model.structures.discovery import package_structures
from sma_sim.model.structures.structure import Coordinate, Structure

PAGE = Path(__file__).resolve().parent / 'reference' / 'parameters.md'
HEAD = """# Parameters

Every number of the model, of its structures and of its effects, in SI units: the default, what is allowed, and for effects
what is met in practice (by which a diagnosis judges whether a value is plausible) and the value at which the effect
vanishes. Names are those of `--set` and of the parameter file. This page is made from the declarations by
`python docs/make_parameters.py`; `sma-sim systems NAME` and `sma-sim effects NAME` print the same with their sources.

A value is refused that was probably given in another unit, such as `wire.sigma_T: 8` for 8 MPa/K: it is far from what real
robots have, and would be among them in that unit. Whoever means it gives it with its unit: `wire.sigma_T: '8 Pa/K'` in a
file, `--set 'wire.sigma_T=8 Pa/K'`, `Config({'wire.sigma_T': '8 Pa/K'})`.
"""
COLUMNS = '| parameter | default | unit | allowed | what it is |\n|---|---|---|---|---|'
EFFECT_COLUMNS = (
    '| parameter | default | unit | allowed | in practice | nothing at | what it is |\n|---|---|---|---|---|---|---|'
)
COORDINATE_COLUMNS = (
    '| coordinate | unit | usual change | of what its sensor shows | stable up to | in a joint or rail | what it is |\n'
    '|---|---|---|---|---|---|---|'
)
COORDINATES = """
## Coordinates

The usual change at the default parameters is what the solver's errors, the noise of the live check and the parameters of
effects are relative to. Beyond `stable up to` a run ends.
"""
GROUPS = (
    ('Wires', 'wire', WIRE_PARAMETERS),
    ('Environment', 'environment', ENVIRONMENT_PARAMETERS),
    ('Solver', 'solver', SOLVER_PARAMETERS),
    ('Node', 'node', NODE_PARAMETERS),
    ('Model check', 'check', CHECK_PARAMETERS),
    ('Observer', 'observer', OBSERVER_PARAMETERS),
    ('Guard', 'guard', GUARD_PARAMETERS),
    ('Control', 'control', CONTROL_PARAMETERS),
)


def between(ends: tuple[float, float] | None) -> str:
    """A range."""
    return f'{ends[0]:g} to {ends[1]:g}' if ends else ''


def row(name: str, p: Parameter) -> str:
    """A parameter of the model."""
    return f'| `{name}` | {p.default:g} | {p.unit} | {between(p.bounds)} | {p.description} |'


def effect_row(p: Parameter) -> str:
    """A parameter of an effect."""
    neutral = '' if p.neutral is None else f'{p.neutral:g}'
    return (
        f'| `{p.name}` | {p.default:g} | {p.unit} | {between(p.bounds)} | {between(p.realistic)} | {neutral} | '
        f'{p.description} |'
    )


def coordinate_row(coordinate: Coordinate, structure: Structure) -> str:
    """A coordinate of a structure."""
    constants = structure.default_constants
    size, shown = coordinate.size(constants), coordinate.sensor_size(constants)
    limit = f'{coordinate.limit:.4g}' if isfinite(coordinate.limit) else ''
    guided = 'yes' if coordinate.joint else ''
    return (
        f'| `{coordinate.name}` | {coordinate.unit} | {size:.4g} | {shown:.4g} | {limit} | {guided} | '
        f'{coordinate.description} |'
    )


def section(title: str, columns: str, rows: Iterable[str]) -> str:
    """A heading and its table."""
    return '\n'.join([f'\n{title}\n', columns, *rows, ''])


def sections() -> Iterator[str]:
    """The page, part by part."""
    yield HEAD
    for title, group, parameters in GROUPS:
        yield section(f'## {title}', COLUMNS, [row(f'{group}.{p.name}', p) for p in parameters])
    yield '\n## Structures\n'
    for name, structure in sorted(package_structures().items()):
        own = structure.declared
        if own and structure.has_own_columns:
            yield section(f'### {name}', COLUMNS, [row(full, p) for full, p in own.items()])
    yield COORDINATES
    for name, structure in sorted(package_structures().items()):
        if structure.coordinates and structure.has_own_columns:
            rows = [coordinate_row(coordinate, structure) for coordinate in structure.coordinates]
            yield section(f'### Coordinates of {name}', COORDINATE_COLUMNS, rows)
    yield '\n## Effects\n\nTheir parameters are `effects.NAME.PARAMETER`.\n'
    for name, effect in find_effects().items():
        yield section(f'### {name}', EFFECT_COLUMNS, map(effect_row, effect.parameters))


def page() -> str:
    """The whole page."""
    return ''.join(sections())


if __name__ == '__main__':
    PAGE.write_text(page())
