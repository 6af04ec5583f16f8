"""Strands of given lengths."""

import numpy as np
import pytest

from mdtopo import InputError, Strands
from mdtopo.records import VertexLabels


@pytest.mark.parametrize(
    ("lengths", "closed", "words"),
    [
        ([0, -3], False, r"^Strand 'strand 0' has 0 vertices; a strand that is open needs at least 2\."),
        ([4, -3], False, r"^Strand 'strand 1' has -3 vertices; a strand that is open needs at least 2\."),
        ([4, 1], False, r"^Strand 'strand 1' has 1 vertex; "),
        ([3, 2], True, r"^Strand 'strand 1' has 2 vertices; a strand that is closed needs at least 3\."),
        ([], False, r"at least one strand"),
        ([3.5, 3], False, r"they must be whole numbers of vertices\.$"),
        ([3, 3], [True], r"^closed has 1 answers for 2 strands; "),
        ([3, 3], [True, False, False], r"^closed has 3 answers for 2 strands; "),
    ],
)
def test_lengths_that_make_no_strands_are_refused_in_one_sentence(
    lengths: list[int], closed: bool | list[bool], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        Strands.from_lengths(lengths, closed=closed)


def test_the_shortest_strands_are_taken() -> None:
    assert Strands.from_lengths([2, 3], closed=[False, True]).n_vertices == 5


def test_all_labels_at_once_are_those_of_the_vertices_one_by_one() -> None:
    labels = VertexLabels(
        chain=np.array(["A", "", "B2"]),
        resid=np.array([12, -3, 100000]),
        icode=np.array(["", "A", ""]),
        resname=np.array(["GLY", "", "α"]),
        atom=np.array(["CA", "", "P"]),
        atom_index=np.arange(3),
    )
    assert labels.texts() == ["A:GLY12", "-3A", "B2:α100000"] == [labels.text(vertex) for vertex in range(3)]
