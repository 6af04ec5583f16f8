"""Is an array a polygon, and what is its size? The gate of the invariants, which users call with bare arrays."""

import numpy as np

from mdtopo.errors import InputError
from mdtopo.typing import Points


def checked_polygon(p: Points, name: str, n_least: int) -> Points:
    """Return p as a C-contiguous float64 array, or raise InputError that says what is wrong with it."""
    try:
        vertices = np.ascontiguousarray(p, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is not an array of numbers ({error}); pass the vertices, shape (n, 3).") from error
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < n_least:
        raise InputError(f"{name} has shape {np.shape(p)}; a polygon needs (n, 3) with n ≥ {n_least} vertices.")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise InputError(f"{name} is not finite at vertex {bad[0]}: {vertices[bad[0]]}; remove or repair the frame.")
    return vertices


def unit_scale(vertices: Points) -> float:
    """Return the power of two that brings the extent into [1, 2): it changes no digit and keeps products in range."""
    extent = float(np.max(np.ptp(vertices, axis=0)))
    return float(2.0 ** -np.floor(np.log2(extent))) if extent > 0.0 else 1.0
