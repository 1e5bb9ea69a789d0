"""A camera that takes more frames in a second than its file says: frame k is shown at k/rate, and was seen before.

shown(t) = value(t/(1 + excess)) from the beginning of the run on, by a cubic spline through the samples: straight lines
between them smooth what was seen, as a slow driver would
"""

import numpy as np
from scipy.interpolate import make_interp_spline

from sma_sim.challenge.truth import Channels, Values, drawn_parameter, sensor_truth
from sma_sim.model.arrays import Vector


def counted_frames(time: Vector, channels: Channels, p: Values) -> dict[str, Vector]:
    """What was seen when each frame was taken."""
    seen = np.where(time > 0.0, time / (1.0 + p['excess']), time)
    return {name: make_interp_spline(time, values, k=3)(seen) for name, values in channels.items()}


TRUTH = sensor_truth(
    'truth_clock_skew',
    counted_frames,
    drawn_parameter('excess', '-', 5e-4, 1e-2, 'frames in a second beyond what the file says, over them'),
    library='clock_skew',
    variables=('t', 'value'),
)
