"""A figure as the page carries it: JSON in which long curves are packed into 16 bits per number, equal ones once.

A packed curve is `{"packed": k}`: entry k of the figure's `packed` has the smallest number, the step, and the multiples of
the step as base64 of unsigned 16-bit integers (little-endian; the largest one is a gap). templates/page.js unpacks them.
The steps are a hundred times finer than the pixels of a screen.
"""

from __future__ import annotations

import base64
import json
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEPS, GAP = 65_534, 65_535
MIN_PACKED = 16  # numbers of a curve that is packed
BINARY = {'float64': ('f8', '<f8'), 'float32': ('f4', '<f4'), 'int32': ('i4', '<i4'), 'uint8': ('u1', '|u1')}


def figure_json(figure: Any) -> str:
    """The text of a `plotly.graph_objects.Figure`; a number that is not finite becomes null, or a gap in a curve."""
    packed: dict[str, int] = {}
    parts = {
        'data': [json_value(trace.to_plotly_json(), packed) for trace in figure.data],
        'layout': json_value(figure.layout.to_plotly_json(), packed),
        'packed': [json.loads(text) for text in packed],
    }
    return json.dumps(parts, separators=(',', ':'), allow_nan=False)


def json_value(value: Any, packed: dict[str, int]) -> Any:
    """JSON's types only; long curves of float32 go to `packed` (text of an entry: its place)."""
    if isinstance(value, dict):
        return {name: json_value(entry, packed) for name, entry in value.items()}
    if isinstance(value, np.ndarray):
        return array_json(value, packed)
    if isinstance(value, list | tuple):
        return [json_value(entry, packed) for entry in value]
    if isinstance(value, np.generic):
        return json_value(value.item(), packed)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def array_json(values: NDArray[Any], packed: dict[str, int]) -> Any:
    """An array: packed, in plotly.js's own binary form, or as a list."""
    if values.dtype == np.float32 and values.ndim == 1 and len(values) >= MIN_PACKED:
        return {'packed': packed.setdefault(json.dumps(packed_curve(values)), len(packed))}
    if values.dtype.name not in BINARY or values.ndim > 2:
        return json_value(values.tolist(), packed)
    name, order = BINARY[values.dtype.name]
    shape = {} if values.ndim == 1 else {'shape': ', '.join(map(str, values.shape))}
    return {'dtype': name, 'bdata': base64_of(values.astype(order)), **shape}


def packed_curve(values: NDArray[np.float32]) -> dict[str, Any]:
    """A curve in 16-bit steps."""
    known = np.isfinite(values)
    exact = values.astype(np.float64)
    low, high = (float(exact[known].min()), float(exact[known].max())) if known.any() else (0.0, 0.0)
    step = (high - low) / STEPS or 1.0
    steps = np.full(len(values), GAP, dtype='<u2')
    steps[known] = np.rint((exact[known] - low) / step)
    return {'low': low, 'step': step, 'steps': base64_of(steps)}


def base64_of(values: NDArray[Any]) -> str:
    """The bytes of an array."""
    return base64.b64encode(values.tobytes()).decode('ascii')
