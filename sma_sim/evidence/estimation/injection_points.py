"""The ports at which something unknown may act: a force, heat, a strain, a stress, power, or an offset of a sensor."""

from __future__ import annotations

from dataclasses import dataclass

from sma_sim.model.effects.ports import CHANNELS

STIFFNESS = 3  # `component` of the port that takes a part of K q


@dataclass(frozen=True)
class Port:
    """An injection point, at which an unknown function of time u(t) [`unit`] may be missing.

    `hook`: the port of the effects that acts there (`Effect.port`); `component`: the wire (0, 1), the coordinate of the
    pose (0, 1, 2 for U_x, U_y, alpha; STIFFNESS: along K q, the beam's own elastic force), or on sensing the channel, an
    index into CHANNELS. `group`: its quantity, which it has in common with the same of the other wire. `probe`: size of a
    small but visible u. `systems`: where it exists.
    """

    name: str
    unit: str
    hook: str
    component: int
    group: str
    probe: float
    systems: tuple[str, ...]
    description: str

    @property
    def adds(self) -> str:
        """What u does to the model, in words."""
        return f'{self.description} [{self.unit}]'


def wire_ports(group: str, unit: str, hook: str, probe: float, what: str) -> list[Port]:
    """The ports of both wires (of the only one, on a wire)."""
    return [
        Port(
            f'{group}_{i + 1}',
            unit,
            hook,
            i,
            group,
            probe,
            ('module', 'wire') if i == 0 else ('module',),
            f'{what} wire {i + 1}',
        )
        for i in range(2)
    ]


FORCES = (
    Port('force_U_x', 'N', 'structure_force', 0, 'force_U_x', 1.0, ('module',), 'force on the plate along the beam'),
    Port('force_U_y', 'N', 'structure_force', 1, 'force_U_y', 0.02, ('module',), 'force on the plate across the beam'),
    Port('moment_alpha', 'N m', 'structure_force', 2, 'moment_alpha', 1e-3, ('module',), 'moment on the plate'),
    Port('stiffness', '-', 'structure_force', STIFFNESS, 'stiffness', 0.02, ('module',), "part of the beam's stiffness"),
)
WIRES = (
    *wire_ports('heat', 'W', 'wire_heat', 0.02, 'heat into one strand of'),
    *wire_ports('strain', '-', 'wire_strain', 1e-4, 'strain, neither elastic nor of martensite, of'),
    *wire_ports('stress', 'Pa', 'transformation_stress', 5e5, 'shift of both transformation stresses of'),
    *wire_ports('power', '-', 'actuation', 0.02, 'share of the electrical heating of'),
)
SENSOR_UNITS = ('m', 'm', 'rad', 'N', 'N', 'K', 'K', 'Pa', 'K')  # by CHANNELS
SENSOR_PROBES = (1e-5, 1e-4, 2e-3, 0.2, 0.2, 1.0, 1.0, 1e6, 1.0)
SENSORS = tuple(
    Port(
        f'sense_{channel}', SENSOR_UNITS[k], 'sensing', k, f'sense_{channel}', SENSOR_PROBES[k],
        ('module',) if k < 7 else ('wire',), f'offset of the shown {channel}',
    )
    for k, channel in enumerate(CHANNELS)
)  # fmt: skip
PORTS: tuple[Port, ...] = (*FORCES, *WIRES, *SENSORS)


def ports_of(system: str, channels: tuple[str, ...]) -> tuple[Port, ...]:
    """The ports of a system; of the sensors those of the channels that were recorded."""
    return tuple(
        port for port in PORTS
        if system in port.systems and (port.hook != 'sensing' or CHANNELS[port.component] in channels)
    )  # fmt: skip
