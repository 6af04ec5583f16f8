"""Array aliases: the shape and the unit of what is passed around.

Lengths are in Å, times in ps, angles in degrees. Positions are C-contiguous float64.
"""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Points: TypeAlias = NDArray[np.float64]
"""Positions, shape (n, 3), Å."""

PointSeries: TypeAlias = NDArray[np.float64]
"""Positions of several frames, shape (n_frames, n, 3), Å."""

BezierPoints: TypeAlias = NDArray[np.float64]
"""Control points of Bezier segments, shape (n_segments, degree + 1, 3), Å."""

Cell: TypeAlias = NDArray[np.float64]
"""Rows are the three lattice vectors, shape (3, 3), Å."""

Lengths: TypeAlias = NDArray[np.float64]
"""Lengths, shape (n,), Å."""

Times: TypeAlias = NDArray[np.float64]
"""Times, shape (n,), ps."""

Ratios: TypeAlias = NDArray[np.float64]
"""Dimensionless ratios, shape (n,)."""

Indices: TypeAlias = NDArray[np.int64]
"""0-based indices; the shape stands in the docstring."""

Flags: TypeAlias = NDArray[np.bool_]
"""Booleans, shape (n,)."""

Codes: TypeAlias = NDArray[np.int8]
"""Values of one of the enums in `mdtopo.records`, shape (n,)."""

JsonObject: TypeAlias = Mapping[str, Any]
"""A JSON object."""
