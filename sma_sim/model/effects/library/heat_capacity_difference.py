"""Martensite and austenite that differ in their heat capacity.

c(x_M) = c_V (1 + r (x_M - 1/2)),   stored beside U: rho Om c_V r (x_M - 1/2) (T - T_ref)   [J], whose rate is
Om rho c_V r [(x_M - 1/2) dT/dt + (T - T_ref) dx_M/dt]: a heat capacity, and latent heat that T_ref and no other temperature
leaves as it is, as the first law asks where the capacities differ (Kirchhoff's law, dL_x/dT = -Om rho (c_M - c_A)).
"""

from typing import Any

from sma_sim.model.effects.effect import Effect
from sma_sim.model.effects.ports import State
from sma_sim.model.parameters import Parameter, WireConstants


def heat_and_capacity(s: State, w: WireConstants, p: Any) -> tuple[float, float]:
    """Heat into the wire [W], and what it has more of heat capacity [J/K]."""
    difference = p.r * w.volume * w.rho * w.c_V
    return -difference * (s.T - p.T_ref) * s.dx, difference * (s.x - 0.5)


EFFECT = Effect(
    name='heat_capacity_difference',
    title='a heat capacity that differs between the phases',
    port='wire_heat',
    equation='C = Om rho c_V (1 + r (x_M - 1/2)); Q = -r Om rho c_V (T - T_ref) dx_M/dt',
    source="Kirchhoff's law of heats of transformation: Zemansky and Dittman, Heat and Thermodynamics; c by phase: "
    'Lagoudas, Shape Memory Alloys, 3.2',
    parameters=(
        Parameter(
            'r',
            0.15,
            '-',
            (-1.5, 1.5),
            'heat capacity of martensite less that of austenite, over c_V',
            neutral=0.0,
            realistic=(-0.4, 0.4),
        ),
        Parameter(
            'T_ref',
            323.0,
            'K',
            (1.0, 2000.0),
            'temperature at which the latent heat is that of the model',
            realistic=(290.0, 370.0),
        ),
    ),
    kernel=heat_and_capacity,
    energy='stored in the wire beside U, and given back',
    description='c_V is that of half martensite; that sigma_A and sigma_M bend with it, in (T - T_ref)^2, is left out',
    signature='the same power warms austenite faster (r > 0) or slower than martensite; nothing at rest',
    confused_with=('wire.c_V', 'latent_heat_scale'),
)
