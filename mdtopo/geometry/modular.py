"""The determinant of a matrix of integers, exactly: modulo primes, put together. The kernels trust their input."""

from math import isqrt, prod

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mdtopo.typing import Indices

LARGEST_PRIME = 2**31 - 1
"""Residues below 2^31 have products below 2^62, which int64 holds."""


def exact_determinant(matrix: Indices) -> int:
    """Return the determinant of a sparse integer matrix of small entries, exactly.

    Residues modulo primes below 2^31 are put together by the Chinese remainder theorem until the modulus exceeds twice
    Hadamard's bound Π|row|.
    """
    if len(matrix) == 0:
        return 1
    bound = 2 * (isqrt(prod(int(s) for s in (matrix * matrix).sum(axis=1))) + 1)
    value, modulus, prime = 0, 1, LARGEST_PRIME + 2
    while modulus <= bound:
        prime = prime_below(prime)
        residue = int(_determinant_modulo(matrix % prime, prime))
        value += modulus * ((residue - value) * pow(modulus, -1, prime) % prime)
        modulus *= prime
    return value if 2 * value < modulus else value - modulus


@njit(cache=True, nogil=True)
def prime_below(odd: int) -> int:
    """Return the greatest prime below an odd number > 5, by trial division."""
    candidate = odd - 2
    divisor = 3
    while divisor * divisor <= candidate:
        if candidate % divisor == 0:
            candidate, divisor = candidate - 2, 3
        else:
            divisor += 2
    return candidate


@njit(cache=True, nogil=True)
def _inverse_modulo(value: int, prime: int) -> int:
    """Return 1 / value modulo a prime, by Euclid's algorithm."""
    r0, r1, s0, s1 = prime, value, 0, 1
    while r1 != 0:
        quotient = r0 // r1
        r0, r1 = r1, r0 - quotient * r1
        s0, s1 = s1, s0 - quotient * s1
    return s0 % prime


@njit(cache=True, nogil=True)
def _is_odd(order: NDArray[np.int64]) -> bool:
    """Return whether a permutation is odd; it is destroyed."""
    odd = False
    for i in range(len(order)):
        while order[i] != i:
            j = order[i]
            order[i], order[j] = order[j], j
            odd = not odd
    return odd


@njit(cache=True, nogil=True)
def _determinant_modulo(matrix: NDArray[np.int64], prime: int) -> int:
    """Return the determinant modulo a prime below 2^31; the matrix, of residues, is destroyed.

    Each pivot lies in the row with the fewest entries and there in the column with the fewest: a knot diagram is a
    planar graph, and so ordered its elimination stays sparse. The work outside the filled part is O(n²).
    """
    n = len(matrix)
    in_row, in_column = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for i in range(n):
        for j in range(n):
            if matrix[i, j] != 0:
                in_row[i] += 1
                in_column[j] += 1
    open_rows = np.ones(n, np.bool_)
    row_order, column_order, columns = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    value = 1
    for step in range(n):
        pivot = -1
        for i in range(n):
            if open_rows[i] and (pivot < 0 or in_row[i] < in_row[pivot]):
                pivot = i
        n_columns, best = 0, -1
        for j in range(n):
            if matrix[pivot, j] != 0:
                columns[n_columns] = j
                n_columns += 1
                if best < 0 or in_column[j] < in_column[best]:
                    best = j
        if best < 0:
            return 0
        row_order[step], column_order[step], open_rows[pivot] = pivot, best, False
        value = value * matrix[pivot, best] % prime
        inverse = _inverse_modulo(matrix[pivot, best], prime)
        for k in range(n_columns):
            in_column[columns[k]] -= 1
        for i in range(n):
            if not open_rows[i] or matrix[i, best] == 0:
                continue
            factor = prime - matrix[i, best] * inverse % prime
            for k in range(n_columns):
                j = columns[k]
                old = matrix[i, j]
                new = (old + factor * matrix[pivot, j]) % prime
                matrix[i, j] = new
                change = (1 if new != 0 else 0) - (1 if old != 0 else 0)
                in_row[i] += change
                in_column[j] += change
    if _is_odd(row_order) != _is_odd(column_order):
        value = (prime - value) % prime
    return value
