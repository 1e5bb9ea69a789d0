"""What arrays of numbers are called in annotations: how long they are, docstrings say."""

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Mask = NDArray[np.bool_]
Integers = NDArray[np.int64]
