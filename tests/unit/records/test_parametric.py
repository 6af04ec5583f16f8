import math

import pytest

import mdtopo
from mdtopo.errors import InputError


def test_a_plane_curve_lies_in_the_plane() -> None:
    curve = mdtopo.ParametricCurve(lambda t: (t, t * t), lambda t: (0, 2), lambda t: (1, 2 * t))
    assert curve.point(0.5).tolist() == [0.5, 0.25, 0.0]
    assert curve.velocity(0.5).tolist() == [1.0, 1.0, 0.0]


def test_the_first_derivative_is_asked_for_by_name() -> None:
    with pytest.raises(InputError, match="first derivative: ParametricCurve"):
        mdtopo.ParametricCurve(lambda t: (t, t), lambda t: (0, 0)).velocity(0.5)


@pytest.mark.parametrize(
    ("bend", "message"),
    [
        (lambda t: (0.0, math.inf), "finite values, on all of"),
        (lambda t: (0.0, 0.25 * t**-1.5), r"second_derivative\(0\) cannot be computed"),
        (lambda t: 0.0, r"second_derivative\(0\) has shape \(\); expected two or three coordinates"),
        (lambda t: (0.0, 0.0, 0.0, 0.0), r"has shape \(4,\)"),
        (lambda t: ("a", "b"), "did not give numbers"),
        (lambda t: None, r"has shape \(\)|did not give numbers"),
    ],
    ids=["infinite", "division by zero", "scalar", "four coordinates", "text", "nothing"],
)
def test_functions_that_cannot_be_used(bend, message: str) -> None:
    with pytest.raises(InputError, match=message):
        mdtopo.ParametricCurve(lambda t: (t, t), bend)


def test_a_closed_curve_ends_where_it_starts() -> None:
    near = mdtopo.ParametricCurve(
        lambda t: (math.cos(2 * math.pi * t), math.sin(2 * math.pi * t)),
        lambda t: (-4 * math.pi**2 * math.cos(2 * math.pi * t), -4 * math.pi**2 * math.sin(2 * math.pi * t)),
        closed=True,
    )
    assert near.closed
    with pytest.raises(InputError, match="position\\(0\\) and position\\(1\\) are 1e-06 apart"):
        mdtopo.ParametricCurve(lambda t: (1e-6 * t, math.sin(2 * math.pi * t)), lambda t: (0, 0), closed=True)
