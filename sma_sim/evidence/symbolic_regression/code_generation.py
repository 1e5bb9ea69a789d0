"""What all written effect files share: what a kernel returns at a place, and the folders in which they lie."""

from __future__ import annotations

from hashlib import sha256
from threading import Lock

from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.estimation.injection_points import STIFFNESS
from sma_sim.evidence.symbolic_regression.locations import BOTH_WIRES, STAGES, Place
from sma_sim.model.effects.discovery import FoundEffect, find_effects
from sma_sim.model.effects.ports import CHANNELS
from sma_sim.solver.compile import cache_folder

LOADING = Lock()


def located(place: Place, value: str, constants: str = 'w') -> str:
    """What the kernel of an effect at a place returns for a value there."""
    if place.hook == 'structure_force':
        if place.component == STIFFNESS:
            b = constants
            return (
                f'({value} * {b}.k_x * s.U_x, {value} * ({b}.k_y * s.U_y - {b}.k_ya * s.alpha), '
                f'{value} * ({b}.k_a * s.alpha - {b}.k_ya * s.U_y))'
            )
        return '(' + ', '.join(value if k == place.component else '0.0' for k in range(3)) + ')'
    if place.hook == 'sensing':
        return f's.value + {value}'
    if place.component != BOTH_WIRES:
        value = f'{"s.wire" if place.component == 1 else "(1.0 - s.wire)"} * {value}'
    if place.hook == 'actuation':
        return f's.J + {value}'
    return f'({value}, {value})' if place.hook == 'transformation_stress' else value


def effect_of(name: str, text: str) -> FoundEffect:
    """The effect of that name in a file with this text, which lies alone in a folder of the user's cache.

    Threads take turns: loading a file changes the table of modules.
    """
    folder = cache_folder(f'formula-{sha256((name + text).encode()).hexdigest()[:20]}')
    file = folder / f'{name}.py'
    with LOADING:
        if not file.exists() or file.read_text() != text:
            write_whole(file, lambda out: out.write(text))
        return find_effects([folder])[name]


def common_lines(hook: str, component: int | None = None) -> list[str]:
    """The lines of an effect that follow from its port (on sensing: from its channel)."""
    lines = [f'stage={STAGES[hook]!r},'] if hook in STAGES else []
    if hook == 'sensing' and component is not None:
        lines.append(f'channels=({CHANNELS[component]!r},),')
    if hook == 'structure_force':
        lines.append("systems=('module',),")
    return lines
