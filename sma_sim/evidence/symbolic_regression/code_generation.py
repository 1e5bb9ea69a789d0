"""What all generated effect files share: what a kernel returns at a location, and the folders in which they lie."""

from __future__ import annotations

from hashlib import sha256
from threading import Lock

from sma_sim.compiler.compile import cache_folder
from sma_sim.evidence.data.tables import write_whole
from sma_sim.evidence.estimation.injection_points import STIFFNESS
from sma_sim.evidence.symbolic_regression.locations import CHAIN_STAGES, EVERY_WIRE
from sma_sim.model.effects.discovery import find_effects
from sma_sim.model.effects.effect import Effect
from sma_sim.model.structures.structure import Structure

LOADING_LOCK = Lock()
STIFFNESS_IMPORT = 'from sma_sim.model.structures.beam import stiffness_forces\n'  # for what acts along K q


def kernel_return(hook: str, component: int, value: str, structure: Structure, constants: str = 'w') -> str:
    """What the kernel of an effect returns for a value at a location, a component of a port."""
    if hook == 'structure_force':
        if component == STIFFNESS:
            return f'stiffness_forces(s.U_x, s.U_y, s.alpha, {constants}, {value})'
        count = len(structure.coordinates)
        each = ', '.join(value if k == component else '0.0' for k in range(count))
        return f'({each})' if count > 1 else each
    if hook == 'sensing':
        return f's.value + {value}'
    value = in_wire(component, structure.wires, value)
    if hook == 'actuation':
        return f's.J + {value}'
    return f'({value}, {value})' if hook == 'transformation_stress' else value


def in_wire(wire: int, wires: int, value: str) -> str:
    """An expression that is zero in other wires than one."""
    if wire == EVERY_WIRE or wires == 1:
        return value
    if wires == 2:
        return f'{"s.wire" if wire == 1 else "(1.0 - s.wire)"} * {value}'
    return f'(1.0 if s.wire == {float(wire)!r} else 0.0) * {value}'


def load_generated(name: str, text: str) -> Effect:
    """The effect of that name in a file with this text, which lies alone in a folder of the user's cache.

    Threads take turns: loading a file changes the table of modules.
    """
    folder = cache_folder(f'formula-{sha256((name + text).encode()).hexdigest()[:20]}')
    file = folder / f'{name}.py'
    with LOADING_LOCK:
        if not file.exists() or file.read_text(encoding='utf-8') != text:
            write_whole(file, lambda out: out.write(text))
        return find_effects([folder])[name]


def port_lines(hook: str, structure: Structure, channel: str = '') -> list[str]:
    """The lines of an effect that follow from its port and structure (on sensing: from its channel; default all)."""
    lines = [f'stage={CHAIN_STAGES[hook]!r},'] if hook in CHAIN_STAGES else []
    if hook == 'sensing':
        lines.append(f'channels={(channel,) if channel else structure.channels!r},')
    if hook == 'structure_force':
        lines.append(f'systems=({structure.family!r},),')
    return lines
