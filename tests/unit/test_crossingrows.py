"""Passages as rows of the table, by hand."""

import math
from dataclasses import fields

import numpy as np
import pytest
from numpy.typing import NDArray

from mdtopo.crossingrows import ROW, CrossingRows, columns_of, in_order_of_time, write_rows
from mdtopo.records import Crossings, Grade, Shape

EDGES = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])


def passage(i: int, j: int, t: float) -> list[float]:
    """Return a row of `Found`: image, time, parameters, point, sign, ρ, shorter edge."""
    return [i, j, 1, -2, 0, t, 0.25, 0.75, 5, 6, 7, -1, 0.5, 0.625]


def written(*passages: list[float], resolution: float = math.nan) -> CrossingRows:
    rows = np.empty(len(passages), dtype=ROW)
    write_rows(np.array(passages), EDGES, 7, 70, 80, Shape.CURVE, resolution, rows)
    return rows


def test_the_columns_are_those_of_the_table_of_crossings() -> None:
    names = [entry.name for entry in fields(Crossings) if entry.name != "strands"]
    found, none = columns_of(np.empty(0, dtype=ROW)), Crossings.none()
    assert list(found) == names
    for name, column in found.items():
        assert (column.dtype, column.shape) == (getattr(none, name).dtype, getattr(none, name).shape), name


def test_a_passage_is_written_as_it_is_where_its_edges_stand_in_order() -> None:
    rows = written(passage(0, 2, 0.5))
    assert (rows["step"][0], rows["frame_t0"][0], rows["frame_t1"][0], rows["object"][0]) == (7, 70, 80, Shape.CURVE)
    assert rows["edges"][0].tolist() == [[0, 1], [2, 3]]
    assert rows["parameters"][0].tolist() == [0.25, 0.75]
    assert rows["image"][0].tolist() == [1, -2, 0]
    assert rows["point"][0].tolist() == [5, 6, 7]
    assert (rows["t"][0], rows["sign"][0], rows["motion"][0], rows["resolution"][0]) == (0.5, -1, 0.5, 0.625)


def test_edges_change_places_with_their_parameters_and_the_image_is_seen_from_the_other() -> None:
    rows = written(passage(2, 0, 0.5))
    assert rows["edges"][0].tolist() == [[0, 1], [2, 3]]
    assert rows["parameters"][0].tolist() == [0.75, 0.25]
    assert rows["image"][0].tolist() == [-1, 2, 0]
    assert rows["sign"][0] == -1  # det(a - c, b - a, d - c) is the same for both orders


@pytest.mark.parametrize(("length", "grade"), [(0.5, Grade.UNDERSAMPLED), (np.nextafter(0.5, 1), Grade.RESOLVED)])
def test_a_crossing_is_resolved_where_its_edges_move_less_than_the_resolution_length(
    length: float, grade: Grade
) -> None:
    rows = written(passage(0, 2, 0.5), resolution=length)
    assert (rows["resolution"][0], rows["grade"][0]) == (length, grade)
    shorter = passage(0, 2, 0.5)
    shorter[13] = length
    assert written(shorter)["grade"][0] == grade


def order(rows: NDArray[np.float64]) -> list[tuple[int, int]]:
    return [(int(i), int(j)) for i, j in in_order_of_time(rows, EDGES)[:, :2]]


def test_passages_stand_in_order_of_time_and_those_of_one_time_in_order_of_vertices() -> None:
    later, higher, lower = passage(0, 2, 0.75), passage(3, 1, 0.25), passage(3, 0, 0.25)
    for rows in ([later, higher, lower], [lower, later, higher], [higher, lower, later]):
        assert order(np.array(rows)) == [(3, 0), (3, 1), (0, 2)]
