"""Which vertices form which strand, and what each vertex is called."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mdtopo.errors import StrandError
from mdtopo.typing import Flags, Indices

CLOSED_MINIMUM = 3
"""A ring of two vertices would run along one edge twice."""

OPEN_MINIMUM = 2
"""A single vertex has no edge, so nothing can be said of it."""


@dataclass(frozen=True, slots=True, eq=False)
class VertexLabels:
    """What the input file calls each vertex.

    Attributes
    ----------
    chain, icode, resname, atom : ndarray of str, shape (n,)
        Chain (or molecule) label, insertion code, residue name, atom name; empty strings where unknown.
    resid : ndarray of int, shape (n,)
        Residue number.
    atom_index : ndarray of int, shape (n,)
        0-based index of the atom in the input file.
    """

    chain: NDArray[np.str_]
    resid: Indices
    icode: NDArray[np.str_]
    resname: NDArray[np.str_]
    atom: NDArray[np.str_]
    atom_index: Indices

    @classmethod
    def unknown(cls, n_vertices: int) -> "VertexLabels":
        """Return labels that say nothing but the index: vertex i is residue i."""
        index = np.arange(n_vertices, dtype=np.int64)
        empty = np.full(n_vertices, "", dtype=np.str_)
        return cls(empty, index, empty, empty, empty, index)

    def text(self, vertex: int) -> str:
        """Return the label of one vertex, such as ``A:GLY12`` or ``2:57``."""
        i = int(vertex)
        return _label(self.chain[i], self.resname[i], self.resid[i], self.icode[i])

    def texts(self) -> list[str]:
        """Return the labels of all vertices."""
        columns = (self.chain, self.resname, self.resid, self.icode)
        return [_label(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]


def _label(chain: str, resname: str, resid: int, icode: str) -> str:
    return f"{chain}:{resname}{resid}{icode}" if chain else f"{resname}{resid}{icode}"


@dataclass(frozen=True, slots=True)
class Gap:
    """A place where a strand was cut because two consecutive vertices are not joined.

    Attributes
    ----------
    vertices : tuple of int
        The last vertex before the gap and the first one after it.
    reason : str
        Why there is no edge, in words.
    """

    vertices: tuple[int, int]
    reason: str


SHOWN = 5
"""Strands that are named at a prompt."""


@dataclass(frozen=True, eq=False, repr=False)
class Strands:
    """Ordered backbone traces, open or closed; constant over a run.

    Attributes
    ----------
    offsets : ndarray of int, shape (n_strands + 1,)
        Strand s holds the vertices offsets[s] … offsets[s + 1] - 1, in order.
    closed : ndarray of bool, shape (n_strands,)
        Whether a closing edge joins the last vertex to the first.
    names : tuple of str, length n_strands
        What the strand is called.
    labels : VertexLabels
        What each vertex is called.
    gaps : tuple of Gap
        Where strands were cut, and why. Nothing is guaranteed across a gap.

    Raises
    ------
    StrandError
        If the offsets do not rise from 0, a strand has fewer than two vertices, or a ring fewer than three.

    Examples
    --------
    >>> Strands.from_lengths([2, 3], closed=[False, True]).edges.tolist()
    [[0, 1], [2, 3], [3, 4], [4, 2]]
    """

    offsets: Indices
    closed: Flags
    names: tuple[str, ...]
    labels: VertexLabels
    gaps: tuple[Gap, ...] = field(default=())

    def __post_init__(self) -> None:
        lengths = np.diff(self.offsets)
        if len(self.offsets) < 2 or self.offsets[0] != 0:
            raise StrandError("Strand offsets must start at 0 and hold at least one strand.")
        _refuse_short(lengths.tolist(), self.closed.tolist(), self.names)

    def __repr__(self) -> str:
        """Return the strands in one line: the labels of a million vertices are no help at a prompt."""
        sizes = np.diff(self.offsets).tolist()
        words = [
            f"{name!r} ({'ring' if closed else 'open'}, {size})"
            for name, closed, size in zip(self.names[:SHOWN], self.closed, sizes, strict=False)
        ]
        more = ", …" if len(self.names) > SHOWN else ""
        return f"<Strands: {len(self.names)} with {sum(sizes)} vertices: {', '.join(words)}{more}>"

    @classmethod
    def from_lengths(
        cls,
        lengths: Sequence[int],
        *,
        closed: bool | Sequence[bool] = False,
        names: Sequence[str] | None = None,
    ) -> "Strands":
        """Return strands of the given numbers of vertices, stored one after the other.

        Parameters
        ----------
        lengths : sequence of int
            Number of vertices of each strand.
        closed : bool or sequence of bool
            Whether the strands are rings: one answer for all, or one for each.
        names : sequence of str, optional
            Names; ``strand 0``, ``strand 1``, … by default.

        Raises
        ------
        StrandError
            If there is no strand, or one has fewer than two vertices, or a ring fewer than three; if a length is no
            whole number, or `closed` answers for another number of strands.
        """
        sizes = np.asarray(lengths)
        if sizes.size and not np.issubdtype(sizes.dtype, np.integer):
            raise StrandError(f"The lengths of the strands are {lengths!r}; they must be whole numbers of vertices.")
        offsets = np.concatenate([[0], np.cumsum(sizes.astype(np.int64))])
        n_strands = len(offsets) - 1
        if not isinstance(closed, bool | np.bool_) and len(closed) != n_strands:
            raise StrandError(
                f"closed has {len(closed)} answers for {n_strands} strands; give one for all, or one each."
            )
        rings = np.broadcast_to(np.asarray(closed, dtype=np.bool_), (n_strands,)).copy()
        titles = tuple(names) if names is not None else tuple(f"strand {s}" for s in range(n_strands))
        _refuse_short(np.diff(offsets).tolist(), rings.tolist(), titles)
        labels = VertexLabels.unknown(int(offsets[-1]))
        return cls(offsets, rings, titles, labels)

    @property
    def n_strands(self) -> int:
        """Number of strands."""
        return len(self.closed)

    @property
    def n_vertices(self) -> int:
        """Number of vertices of all strands together."""
        return int(self.offsets[-1])

    @cached_property
    def strand_of_vertex(self) -> Indices:
        """The strand of each vertex, shape (n_vertices,)."""
        return np.repeat(np.arange(self.n_strands, dtype=np.int64), np.diff(self.offsets))

    @cached_property
    def edges(self) -> Indices:
        """All edges in strand order, shape (n_edges, 2); a ring's closing edge comes last in it."""
        pieces = []
        for start, stop, ring in zip(self.offsets[:-1], self.offsets[1:], self.closed, strict=True):
            vertices = np.arange(start, stop, dtype=np.int64)
            ends = np.roll(vertices, -1) if ring else vertices[1:]
            pieces.append(np.stack([vertices[: len(ends)], ends], axis=1))
        return np.concatenate(pieces)

    def describe_edge(self, edge: Sequence[int]) -> str:
        """Return an edge in words, such as ``A:GLY12-ALA13``; the chain is said once."""
        tail, head = (self.labels.text(int(v)) for v in edge)
        return f"{tail}-{head.split(':', 1)[-1]}"

    def describe_pair(self, pair: Indices, joined_by: str = "x") -> str:
        """Return a pair [[a, b], [c, d]] in words, such as ``A:GLY12-ALA13 x B:SER4-THR5``; [a, a] is a vertex."""
        first, second = (self.labels.text(a) if a == b else self.describe_edge((a, b)) for a, b in pair)
        return f"{first} {joined_by} {second}"


def _refuse_short(lengths: Sequence[int], closed: Sequence[bool], names: Sequence[str]) -> None:
    for length, ring, name in zip(lengths, closed, names, strict=True):
        least = CLOSED_MINIMUM if ring else OPEN_MINIMUM
        if length < least:
            raise StrandError(
                f"Strand {name!r} has {_vertices(int(length))}; a strand that is {'closed' if ring else 'open'} needs "
                f"at least {least}. Select more atoms, or leave this strand out."
            )


def _vertices(count: int) -> str:
    return "1 vertex" if count == 1 else f"{count} vertices"
