"""The clamp of wire 1 slips at an instant: it lets the wire through until friction holds again, over a tenth of a second.

e = way/l0 (3 u^2 - 2 u^3)   [-],   u = (t - t_slip)/0.1 s between 0 and 1
"""

from sma_sim.challenge.truth import drawn_parameter, simulated_truth
from sma_sim.model.effects.effect import Effect

TAKES = 0.1  # [s]


def slipped(t: float, instant: float) -> float:
    """The part of the way that is made."""
    u = min(max((t - instant) / TAKES, 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)


EFFECT = Effect(
    name='truth_clamp_slip',
    port='wire_strain',
    equation='e = way/l0 (3 u^2 - 2 u^3) in wire 1, u = (t - t_slip)/0.1 s in 0 to 1',
    source='stick and slip',
    parameters=(
        drawn_parameter('way', 'm', 2e-4, 1.5e-3, 'way by which the wire slips through its clamp'),
        drawn_parameter('t_slip', 's', 20.0, 80.0, 'instant'),
    ),
    kernel=lambda s, w, p: p.way / w.l0 * slipped(s.t, p.t_slip) if s.wire < 0.5 else 0.0,
    energy='the work of the way is lost in the clamp',
)
TRUTH = simulated_truth(EFFECT, library='clamp_slip', variables=('t', 'wire'))
