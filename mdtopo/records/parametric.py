"""A smooth curve given by functions of its parameter."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mdtopo.errors import InputError
from mdtopo.typing import Points

CurveFunction = Callable[[float], ArrayLike]
"""A function of one number in [0, 1] that returns two or three coordinates."""

PROBES = (0.0, 0.5, 1.0)
"""Parameters at which the functions are called once, so that a wrong shape is found where it is made."""

CLOSURE = 1e-9
"""How far the ends of a closed curve may be apart, as a multiple of its extent: rounding of sin(2π) and the like."""


@dataclass(frozen=True, slots=True, eq=False)
class ParametricCurve:
    """One C² curve c on [0, 1], open or closed.

    Attributes
    ----------
    position, second_derivative : callable
        c(t) and c''(t): functions of one float that return two or three coordinates, Å. A curve in the plane lies in
        z = 0.
    first_derivative : callable, optional
        c'(t). Only `tube` needs it.
    closed : bool
        Whether the curve ends where it starts, smoothly.

    Raises
    ------
    InputError
        A function returns another shape or a value that is not finite, or a closed curve's ends are apart.

    Examples
    --------
    >>> parabola = ParametricCurve(lambda t: (t, t * t), lambda t: (0.0, 2.0))
    >>> parabola.bend(0.25).tolist()
    [0.0, 2.0, 0.0]
    """

    position: CurveFunction
    second_derivative: CurveFunction
    first_derivative: CurveFunction | None = None
    closed: bool = False

    def __post_init__(self) -> None:
        points = np.stack([self.point(t) for t in PROBES])
        for t in PROBES:
            self.bend(t)
            if self.first_derivative is not None:
                self.velocity(t)
        apart, extent = np.linalg.norm(points[-1] - points[0]), np.abs(np.diff(points, axis=0)).max()
        if self.closed and not apart <= CLOSURE * (extent + np.abs(points).max()):
            raise InputError(
                f"A closed curve must end where it starts; position(0) and position(1) are {apart:.6g} apart."
            )

    def point(self, t: float) -> NDArray[np.float64]:
        """Return c(t), shape (3,), Å."""
        return called(self.position, "position", t)

    def velocity(self, t: float) -> NDArray[np.float64]:
        """Return c'(t), shape (3,), Å.

        Raises
        ------
        InputError
            No first derivative was given, or it cannot be used.
        """
        if self.first_derivative is None:
            raise InputError("This needs the curve's first derivative: ParametricCurve(..., first_derivative=...).")
        return called(self.first_derivative, "first_derivative", t)

    def bend(self, t: float) -> NDArray[np.float64]:
        """Return c''(t), shape (3,), Å."""
        return called(self.second_derivative, "second_derivative", t)

    def points(self, parameters: NDArray[np.float64]) -> Points:
        """Return c at each parameter, shape (n, 3), Å."""
        return np.stack([self.point(float(t)) for t in parameters])


def called(function: CurveFunction, name: str, t: float) -> NDArray[np.float64]:
    """Return three finite coordinates from a curve's function; `name` is what a message calls it."""
    try:
        value = np.asarray(function(t), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}({t:g}) did not give numbers ({error}); expected two or three coordinates.") from error
    except ArithmeticError as error:  # 1/t at 0, and the like
        raise InputError(
            f"{name}({t:.6g}) cannot be computed ({error}); the curve must be C² on all of [0, 1]."
        ) from error
    if value.shape not in ((2,), (3,)):
        raise InputError(f"{name}({t:g}) has shape {value.shape}; expected two or three coordinates.")
    if not np.isfinite(value).all():
        raise InputError(
            f"{name}({t:.6g}) is {value.tolist()}; the curve must be C², with finite values, on all of [0, 1]."
        )
    return value if len(value) == 3 else np.append(value, 0.0)
