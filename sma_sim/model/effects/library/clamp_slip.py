"""A clamp that slips at an instant: the wire is longer from then on.

e = delta (1 + tanh(2 (t - t_slip)/w))/2   [-]: the way of the clamp over l0; t since the beginning of the recording
Each bundle has its own delta: `delta` the first, `delta_2`, ... the others. The step is smooth, so that the run and its
derivatives pass through it; it takes the time w.
"""

import math
from dataclasses import replace

from sma_sim.model.effects.effect import EachBundle, Effect
from sma_sim.model.parameters import Parameter

INSTANT = Parameter(
    't_slip', 5.0, 's', (0.0, 1e6), 'instant, from the beginning of the recording', realistic=(1.0, 1e4), quantity='instant'
)
WAY = Parameter('delta', 4e-3, '-', (-0.1, 0.1), 'way of its clamp over l0, bundle 1', neutral=0.0, realistic=(-0.02, 0.02))
RISE = Parameter('w', 0.1, 's', (1e-3, 100.0), 'time that it takes', realistic=(0.02, 2.0))


def smooth_step(t: float, instant: float, w: float) -> float:
    """From 0 to 1 at an instant, with the slope 1/w there."""
    return 0.5 + 0.5 * math.tanh(2.0 * (t - instant) / w)


EFFECT = Effect(
    name='clamp_slip',
    title='a clamp that slips',
    port='wire_strain',
    equation='e = delta (1 + tanh(2 (t - t_slip)/w))/2',
    source='geometry: l0 of a wire whose clamp has moved',
    parameters=(WAY, INSTANT, RISE),
    each_bundle=(EachBundle(replace(WAY, default=0.0, description='the same, bundle'), 2, 2),),
    kernel=lambda s, w, p: p.delta * smooth_step(s.t, p.t_slip, p.w),
    tried='timed',
    straight=True,
    energy='the force times the way of the clamp is lost in the clamp; its heat stays there',
    description='clamps of several bundles slip together',
    signature='all motion after one instant is about another rest, with a transient there',
    confused_with=('functional_fatigue', 'pretension_mismatch'),
)
