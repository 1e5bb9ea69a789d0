"""What sensors do to a pose, applied to its samples: zero errors, scales, lag, rotation, play, ripple, drift."""

import math

import numpy as np

from sma_sim.challenge.truth import Channels, Values, drawn_parameter, sensor_truth
from sma_sim.model.arrays import Vector

DEGREE = math.pi / 180.0


def zero_error(time: Vector, channels: Channels, p: Values) -> dict[str, Vector]:
    """The zero of each sensor was set on a pose that was off."""
    return {name: channels[name] + p[f'zero_{name}'] for name in ('U_x', 'U_y', 'alpha')}


def scale_error(time: Vector, channels: Channels, p: Values) -> dict[str, Vector]:
    """A camera whose pixels are larger or smaller than thought, and an encoder of another radius."""
    camera, encoder = 1.0 / (1.0 + p['pixel']), 1.0 / (1.0 + p['radius'])
    return {'U_x': camera * channels['U_x'], 'U_y': camera * channels['U_y'], 'alpha': encoder * channels['alpha']}


def low_pass(time: Vector, channels: Channels, p: Values) -> dict[str, Vector]:
    """A first-order low-pass filter with a cut-off frequency, exact for lines between the samples."""
    pace = 2.0 * math.pi * p['cut_off']
    return {name: filtered(time, channels[name], pace) for name in ('U_x', 'U_y', 'alpha')}


def filtered(time: Vector, values: Vector, pace: float) -> Vector:
    """y' = pace (values - y), from rest."""
    steps = np.diff(time)
    slopes = np.diff(values) / steps
    out = values.copy()
    for k, (step, slope) in enumerate(zip(steps, slopes, strict=True)):
        behind = slope / pace
        out[k + 1] = values[k + 1] - behind + (out[k] - values[k] + behind) * math.exp(-pace * step)
    return out


def turned_camera(time: Vector, channels: Channels, p: Values) -> dict[str, Vector]:
    """A camera that is turned about its axis sees the pose, counted from the straight beam, in its own axes."""
    motion = (channels['U_x'] + 1j * channels['U_y']) * np.exp(-1j * p['turn'])
    return {'U_x': motion.real, 'U_y': motion.imag, 'alpha': channels['alpha'] - p['turn']}


def play(time: Vector, channels: Channels, p: Values) -> dict[str, Vector]:
    """Play in the gear of the encoder: it follows only when a flank is met."""
    half, shown_angle = 0.5 * p['play'], channels['alpha'][0]
    out = np.empty_like(channels['alpha'])
    for k, angle in enumerate(channels['alpha']):
        shown_angle = min(max(shown_angle, angle - half), angle + half)
        out[k] = shown_angle
    return {'alpha': out}


def ripple(time: Vector, channels: Channels, p: Values) -> dict[str, Vector]:
    """An encoder whose disc is not true: an error that is periodic in the angle."""
    alpha = channels['alpha']
    return {'alpha': alpha + p['amplitude'] * np.sin(p['lines'] * alpha + p['phase'])}


def drift(time: Vector, channels: Channels, p: Values) -> dict[str, Vector]:
    """An encoder that warms up after the beginning of the run."""
    return {'alpha': channels['alpha'] + p['warm'] * (1.0 - np.exp(-np.maximum(time, 0.0) / p['tau']))}


def bumped_camera(time: Vector, channels: Channels, p: Values) -> dict[str, Vector]:
    """Somebody touches the stand of the camera: from then on all displacements are off, and the angle."""
    after = time >= p['t_bump']
    return {name: channels[name] + np.where(after, p[f'off_{name}'], 0.0) for name in ('U_x', 'U_y', 'alpha')}


TRUTHS = (
    sensor_truth(
        'truth_sensor_bias',
        zero_error,
        drawn_parameter('zero_U_x', 'm', 5e-6, 6e-5, 'zero error of U_x'),
        drawn_parameter('zero_U_y', 'm', 3e-5, 4e-4, 'zero error of U_y'),
        drawn_parameter('zero_alpha', 'rad', 0.05 * DEGREE, 0.6 * DEGREE, 'zero error of alpha'),
        library='sensor_bias',
        variables=('constant',),
        signed=('zero_U_x', 'zero_U_y', 'zero_alpha'),
        listed=lambda p, of: {name: p[f'zero_{name}'] for name in ('U_x', 'U_y', 'alpha')},
    ),
    sensor_truth(
        'truth_sensor_gain',
        scale_error,
        drawn_parameter('pixel', '-', 0.01, 0.06, 'size of a pixel over what was thought, less one'),
        drawn_parameter('radius', '-', 0.01, 0.06, "the encoder's radius over what was thought, less one"),
        library='sensor_gain',
        variables=('value',),
        signed=('pixel', 'radius'),
        listed=lambda p, of: {
            'U_x': 1.0 / (1.0 + p['pixel']),
            'U_y': 1.0 / (1.0 + p['pixel']),
            'alpha': 1.0 / (1.0 + p['radius']),
        },
    ),
    sensor_truth(
        'truth_sensor_lag',
        low_pass,
        drawn_parameter('cut_off', 'Hz', 0.3, 5.0, 'cut-off frequency'),
        library='sensor_lag',
        variables=('value', 'memory'),
        listed=lambda p, of: {'tau': 0.5 / math.pi / p['cut_off']},
    ),
    sensor_truth(
        'truth_sensor_misalignment',
        turned_camera,
        drawn_parameter('turn', 'rad', 0.3 * DEGREE, 4.0 * DEGREE, 'angle by which the camera is turned'),
        library='sensor_misalignment',
        variables=('value',),
        signed=('turn',),
        listed=lambda p, of: {'theta': p['turn']},
    ),
    sensor_truth(
        'truth_backlash',
        play,
        drawn_parameter('play', 'rad', 0.1 * DEGREE, 0.8 * DEGREE, 'play'),
        variables=('value', 'memory'),
    ),
    sensor_truth(
        'truth_sensor_ripple',
        ripple,
        drawn_parameter('amplitude', 'rad', 0.04 * DEGREE, 0.3 * DEGREE, 'amplitude'),
        drawn_parameter('lines', '1/rad', 60.0, 150.0, 'waves per radian, times 2 pi'),
        drawn_parameter('phase', 'rad', -3.0, 3.0, 'phase at alpha = 0'),
        variables=('value',),
    ),
    sensor_truth(
        'truth_sensor_drift',
        drift,
        drawn_parameter('warm', 'rad', 0.05 * DEGREE, 0.6 * DEGREE, 'error once it is warm'),
        drawn_parameter('tau', 's', 10.0, 60.0, 'time in which it warms up'),
        library='sensor_drift',
        variables=('t',),
        signed=('warm',),
    ),
    sensor_truth(
        'truth_sensor_jump',
        bumped_camera,
        drawn_parameter('off_U_x', 'm', 5e-6, 6e-5, 'shift of the picture along the beam'),
        drawn_parameter('off_U_y', 'm', 3e-5, 4e-4, 'shift of the picture across it'),
        drawn_parameter('off_alpha', 'rad', 0.05 * DEGREE, 0.6 * DEGREE, 'turn of the picture'),
        drawn_parameter('t_bump', 's', 20.0, 80.0, 'instant'),
        library='sensor_jump',
        variables=('t',),
        signed=('off_U_x', 'off_U_y', 'off_alpha'),
        listed=lambda p, of: {name: p[f'off_{name}'] for name in ('U_x', 'U_y', 'alpha')} | {'t_slip': p['t_bump']},
    ),
)
