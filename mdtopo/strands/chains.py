"""The chains of the selected atoms, from bonds where the file has them, else from labels and distances."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mdtopo.errors import StrandError
from mdtopo.strands.atoms import NUCLEIC, OTHER, PROTEIN, AtomTable
from mdtopo.strands.links import BondGraph, backbone_links
from mdtopo.strands.steps import StepCheck
from mdtopo.typing import Flags, Indices

WRAPPED_NUMBERS = frozenset({(99999, 0), (99999, 1), (9999, 0), (9999, 1)})
"""Residue numbers of five (GRO) or four (PDB) digits start again here within one chain."""


@dataclass(frozen=True, slots=True)
class Run:
    """Rows that edges join one after the other; `closed` if an edge joins the last to the first."""

    rows: list[int]
    closed: bool = False


@dataclass(frozen=True, slots=True)
class Chain:
    """The runs of one chain, and the reason why no edge joins each of them to the next."""

    runs: list[Run]
    reasons: list[str]


def molecules(table: AtomTable, rows: Indices) -> list[Indices]:
    """Return the rows of each molecule, or where the file has none of each chain and segid; in file order."""
    columns = [table.chain, table.segid] if table.molecule is None else [table.molecule]
    groups: dict[tuple[str | int, ...], list[int]] = {}
    # whole columns at once: one value of an array costs more than all that is done with it
    for row, *key in zip(rows.tolist(), *(column[rows].tolist() for column in columns), strict=True):
        groups.setdefault(tuple(key), []).append(row)
    return [np.array(group, dtype=np.int64) for group in groups.values()]


def candidate_pairs(table: AtomTable, groups: Sequence[Indices]) -> Indices:
    """Return the consecutive rows that labels and numbers allow to be joined, shape (m, 2)."""
    pairs = [np.stack([rows[:-1], rows[1:]], axis=1) for rows in groups]
    consecutive = np.concatenate([np.empty((0, 2), dtype=np.int64), *pairs])
    return np.asarray(consecutive[~_part(table, consecutive[:, 0], consecutive[:, 1])], dtype=np.int64)


def ordered_chains(table: AtomTable, rows: Indices, check: StepCheck) -> list[Chain]:
    """Return the chains of atoms whose bonds are unknown, in file order.

    A new chain starts where the residue number falls, or repeats in another residue without an insertion
    code, or the kind of polymer changes, or the atoms belong to residues that no polymer is known to have
    (lipids). Within a chain a step longer than the cut is a gap.
    """
    chains = [Chain([Run([int(rows[0])])], [])]
    for (i, j), parts in zip(_pairs(rows), _part(table, rows[:-1], rows[1:]).tolist(), strict=True):
        if parts:
            chains.append(Chain([Run([j])], []))
        elif reason := check.gap_reason(i, j):
            chains[-1].runs.append(Run([j]))
            chains[-1].reasons.append(reason)
        else:
            chains[-1].runs[-1].rows.append(j)
    return chains


def _part(table: AtomTable, i: Indices, j: Indices) -> Flags:
    return are_chain_ends(table, i, j) | _are_unrelated(table, i, j)


def are_chain_ends(table: AtomTable, i: Indices, j: Indices) -> Flags:
    """Return whether labels and numbers alone say that the rows i end a chain and the rows j start another one."""
    elsewhere = (table.chain[i] != table.chain[j]) | (table.segid[i] != table.segid[j])
    first, second = table.residue_kind[i], table.residue_kind[j]
    changes = ((first == PROTEIN) & (second == NUCLEIC)) | ((first == NUCLEIC) & (second == PROTEIN))
    return np.asarray(
        elsewhere | ((table.residue[i] != table.residue[j]) & (changes | _restart(table, i, j))), dtype=np.bool_
    )


def _restart(table: AtomTable, i: Indices, j: Indices) -> Flags:
    last, first = table.resid[i], table.resid[j]
    wrapped = np.zeros(len(last), dtype=np.bool_)
    for highest, lowest in WRAPPED_NUMBERS:
        wrapped |= (last == highest) & (first == lowest)
    repeated = (first == last) & (table.icode[i] == table.icode[j])
    return np.asarray(repeated | ((first < last) & ~wrapped), dtype=np.bool_)


def _are_unrelated(table: AtomTable, i: Indices, j: Indices) -> Flags:
    # Two residues of several atoms that are no amino acids or nucleotides: lipids as likely as a synthetic
    # polymer. Nothing in the file says that they are joined, and a false edge is worse than a missing strand.
    foreign = (table.residue_kind == OTHER) & (table.residue_size > 1)
    return np.asarray((table.residue[i] != table.residue[j]) & (foreign[i] | foreign[j]), dtype=np.bool_)


def bonded_chains(table: AtomTable, rows: Indices, graph: BondGraph) -> tuple[list[Chain], list[str]]:
    """Return the chains of atoms whose bonds the file lists, and notes on bonds that are no edges.

    Where no atom has more than two neighbours along the backbone, the bonds give order, ends and rings. Else
    the stored order decides: bonds between consecutive atoms are edges, all others are rungs.

    Parameters
    ----------
    table : AtomTable
        The selected atoms.
    rows : ndarray of int
        Those of one molecule or chain.
    graph : BondGraph
        The bonds of the file.

    Raises
    ------
    StrandError
        If the bonds branch and the stored order does not settle the matter either; names the atom.
    """
    links = backbone_links(table, rows, graph)
    partners: dict[int, list[int]] = {int(row): [] for row in rows}
    for i, j in links.tolist():
        partners[i].append(j)
        partners[j].append(i)
    if all(len(found) <= 2 for found in partners.values()):
        return _joined(table, [*_followed_runs(partners)]), []
    _refuse_branches(table, rows, partners)
    runs = _stored_runs(rows, partners)
    n_edges = sum(len(run.rows) - (not run.closed) for run in runs)
    rungs = f"{len(links) - n_edges} bonds of {table.label(int(rows[0]))} … {table.label(int(rows[-1]))}"
    return _joined(table, runs), [f"{rungs} are not between consecutive vertices: rungs or cross-links, not edges."]


def _followed_runs(partners: dict[int, list[int]]) -> Iterator[Run]:
    """Yield the paths and rings of a graph without branches, each from the end that is stored first."""
    seen: set[int] = set()
    for start in partners:
        if start in seen:
            continue
        members = _component(start, partners)
        seen.update(members)
        ends = [row for row in members if len(partners[row]) < 2]
        yield Run(_followed(min(ends or members), partners), closed=not ends)


def _component(start: int, partners: dict[int, list[int]]) -> set[int]:
    found, queue = {start}, deque([start])
    while queue:
        fresh = [row for row in partners[queue.popleft()] if row not in found]
        found.update(fresh)
        queue.extend(fresh)
    return found


def _followed(start: int, partners: dict[int, list[int]]) -> list[int]:
    path, here = [start], min(partners[start], default=start)
    before = start
    while here not in (start, before):
        path.append(here)
        onward = [row for row in partners[here] if row != before]
        before, here = here, onward[0] if onward else start
    return path


def _refuse_branches(table: AtomTable, rows: Indices, partners: dict[int, list[int]]) -> None:
    """Raise if bonds branch and consecutive atoms are not joined, unless a chain has a mere gap."""
    residues = len(set(table.residue[rows].tolist())) == len(rows) and bool((table.residue_kind[rows] != OTHER).all())
    for (i, j), ends in zip(_pairs(rows), are_chain_ends(table, rows[:-1], rows[1:]).tolist(), strict=True):
        if j in partners[i] or residues or ends:
            continue
        branch = next(row for row, found in partners.items() if len(found) > 2)
        raise StrandError(
            f"The bonds branch at {table.label(branch)}, joined to {len(partners[branch])} others, "
            f"and {table.label(i)} is not joined to the next one, {table.label(j)}: the backbone is unclear. "
            "Select backbone atoms only, or pass use_bonds=no to take the atoms in stored order."
        )


def _stored_runs(rows: Indices, partners: dict[int, list[int]]) -> list[Run]:
    runs = [[int(rows[0])]]
    for i, j in _pairs(rows):
        if j in partners[i]:
            runs[-1].append(j)
        else:
            runs.append([j])
    return [Run(run, closed=_closes(run, partners)) for run in runs]


def _closes(run: list[int], partners: dict[int, list[int]]) -> bool:
    # Among rungs a bond between the ends closes a ring only if it is the single bond that the ends have to
    # spare: in an elastic network the ends are joined to many others.
    first, last = run[0], run[-1]
    return len(run) > 2 and first in partners[last] and len(partners[first]) == len(partners[last]) == 2


def _joined(table: AtomTable, runs: Sequence[Run]) -> list[Chain]:
    """Return the chains of runs that no bond joins: gaps in a chain of residues, ends of chains of beads."""
    chains = [Chain([runs[0]], [])]
    lasts = np.array([run.rows[-1] for run in runs[:-1]], dtype=np.int64)
    firsts = np.array([run.rows[0] for run in runs[1:]], dtype=np.int64)
    parted = are_chain_ends(table, lasts, firsts) | (table.residue_kind[firsts] == OTHER)
    for (before, after), parts in zip(pairwise(runs), parted.tolist(), strict=True):
        i, j = before.rows[-1], after.rows[0]
        if before.closed or after.closed or parts:
            chains.append(Chain([after], []))
        else:
            chains[-1].runs.append(after)
            chains[-1].reasons.append(f"no bond joins {table.label(i)} to {table.label(j)}")
    return chains


def _pairs(rows: Indices) -> Iterator[tuple[int, int]]:
    return pairwise(rows.tolist())
