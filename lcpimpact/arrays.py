"""The array types of the project's own signatures."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]
Places: TypeAlias = NDArray[np.uint64]
Flags: TypeAlias = NDArray[np.bool_]
