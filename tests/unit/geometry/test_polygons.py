"""What linking number, writhe and knot determinant have in common: invariance, and the polygons that they refuse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from polygons import SQUARE, Points, polygons, random_ring, turned

from mdtopo.errors import InputError, MdtopoError
from mdtopo.geometry.knots import knot_determinant
from mdtopo.geometry.linking import gauss_linking, linking_number, writhe


@pytest.mark.parametrize("seed", range(5))
def test_invariance_of_place_turn_size_and_start(seed: int) -> None:
    p, q = random_ring(seed, 14), random_ring(seed + 100, 17)
    linked, own, knot = linking_number(p, q), writhe(p), knot_determinant(p)
    for change in (
        lambda x: turned(x, seed),
        lambda x: x + np.array([10.0, -200, 3000]),
        lambda x: x * 1e-30,
        lambda x: x * 1e30,
        lambda x: np.roll(x, 5, axis=0),
        lambda x: x.astype(np.float32).astype(np.float64),
        lambda x: np.insert(x, 3, 0.5 * (x[2] + x[3]), axis=0),
    ):
        assert linking_number(change(p), change(q)) == linked
        assert writhe(change(p)) == pytest.approx(own, abs=1e-5)
        assert knot_determinant(change(p)) == knot
    assert writhe(p * [-1, 1, 1]) == pytest.approx(-own, abs=1e-12)
    assert writhe(p[::-1]) == pytest.approx(own, abs=1e-12)
    assert linking_number(p[::-1], q) == linking_number(p, q * [1, 1, -1] * [1, 1, -1]) - 2 * linked


@given(p=polygons(25), seed=st.integers(0, 1000), shift=st.integers(0, 24))
@settings(max_examples=150, deadline=None)
def test_writhe_and_determinant_are_invariant(p: Points, seed: int, shift: int) -> None:
    changed = np.roll(turned(p, seed), shift, axis=0)
    assert writhe(changed) == pytest.approx(writhe(p), abs=1e-9)
    assert writhe(-changed) == pytest.approx(-writhe(p), abs=1e-9)
    assert knot_determinant(changed) == knot_determinant(-p) == knot_determinant(p)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (SQUARE[:, :2], r"has shape \(4, 2\).*\(n, 3\)"),
        (SQUARE[0], r"has shape \(3,\)"),
        (SQUARE[:2], r"n ≥ 3"),
        (np.empty((0, 3)), r"has shape \(0, 3\)"),
        (np.where(SQUARE == -1, np.nan, SQUARE), r"not finite at vertex 1"),
        (np.where(SQUARE == -1, np.inf, SQUARE), r"not finite at vertex 1"),
        ("a string", "not an array of numbers"),
        ([[0, 0, 0], [1, 2]], "not an array of numbers"),
    ],
)
def test_bad_arrays_are_named(bad: ArrayLike, message: str) -> None:
    for call in (
        lambda: linking_number(bad, SQUARE),  # type: ignore[arg-type]
        lambda: gauss_linking(bad, SQUARE),  # type: ignore[arg-type]
        lambda: writhe(bad),  # type: ignore[arg-type]
        lambda: knot_determinant(bad),  # type: ignore[arg-type]
    ):
        with pytest.raises(
            InputError, match=f"^p (is|has) .*{message[4:] if message.startswith('has ') else ''}"
        ) as caught:
            call()
        assert caught.match(message)
        assert isinstance(caught.value, ValueError)
        assert isinstance(caught.value, MdtopoError)
    with pytest.raises(InputError, match=r"^q "):
        linking_number(SQUARE, bad)  # type: ignore[arg-type]
