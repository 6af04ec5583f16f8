"""Determinants modulo primes, against elimination on fractions."""

from fractions import Fraction

import numpy as np
import pytest
from polygons import determinant_of_fractions

from mdtopo.geometry.modular import exact_determinant, prime_below


@pytest.mark.parametrize("size", [1, 2, 5, 12])
def test_the_exact_determinant_agrees_with_fractions(size: int) -> None:
    rng = np.random.default_rng(size)
    for _ in range(20):
        matrix = rng.integers(-9, 10, size=(size, size)) * rng.integers(0, 2, size=(size, size))
        expected = determinant_of_fractions([[Fraction(int(v)) for v in row] for row in matrix])
        assert exact_determinant(matrix.astype(np.int64)) == expected


def test_primes_are_prime() -> None:
    assert prime_below(2**31 + 1) == 2**31 - 1
    assert prime_below(2**31 - 1) == 2147483629
    assert prime_below(101) == 97
