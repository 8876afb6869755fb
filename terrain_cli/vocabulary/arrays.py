"""Types of arrays, as annotations name them."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Bounds = NDArray[np.intp]  # Of windows: where each begins, and where the last one ends
