"""Atoms to strands: the rules in their order, and what they found, in words."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mdtopo.errors import StrandError
from mdtopo.records import Gap, Strands, VertexLabels
from mdtopo.records.strands import CLOSED_MINIMUM, OPEN_MINIMUM
from mdtopo.strands.atoms import PROTEIN, AtomTable, counted, usable_rows
from mdtopo.strands.chains import Chain, Run, bonded_chains, candidate_pairs, molecules, ordered_chains
from mdtopo.strands.links import BondGraph, has_bonds
from mdtopo.strands.steps import StepCheck
from mdtopo.typing import Cell, Indices, Points


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """The strands of a table of atoms.

    Attributes
    ----------
    order : ndarray of int, shape (n_vertices,)
        The row of the table that each vertex is; rows that are left out do not occur.
    strands : Strands
        The strands, with the places where they were cut.
    notes : tuple of str
        What was left out or is unusual, one sentence each.
    """

    order: Indices
    strands: Strands
    notes: tuple[str, ...]


def strands_from_atoms(
    table: AtomTable,
    positions: Points,
    cell: Cell | None = None,
    *,
    cut: float | None = None,
    use_bonds: bool = True,
    close_ends: bool = False,
) -> Traces:
    """Return the strands that the selected atoms form.

    An edge joins consecutive atoms of one molecule or chain. Where the file has bonds for the atoms, they
    tell where a strand ends and whether it closes, and give the order if the atoms are not stored in it. Else
    a strand ends where molecule, chain or segid change, where residue numbers restart, and where a step after
    the nearest periodic image is longer than a cut; the last is a gap. Ions, spare alternate locations and
    atoms that are joined to no other are left out with a note.

    Parameters
    ----------
    table : AtomTable
        What the file says of the selected atoms.
    positions : ndarray, shape (n, 3)
        One frame, one position for each row of the table, Å; used only where bonds are unknown.
    cell : ndarray, shape (3, 3), or None
        Its cell, rows; None if not periodic.
    cut : float, optional
        Longest edge where bonds are unknown, Å. By default 5.0 from CA to CA, 9.0 from C4' (or P) to C4', and
        three times the median step for other atoms (`mdtopo.strands.steps` has the reasons).
    use_bonds : bool
        Whether to use the file's bonds at all.
    close_ends : bool
        Whether a strand without bonds is a ring when its ends are within the cut.

    Raises
    ------
    StrandError
        If no two selected atoms are joined, or the bonds branch.

    Notes
    -----
    Bonds are taken at their word. Without bonds the result is heuristic, and gaps and notes say what was
    assumed.
    """
    rows, notes = usable_rows(table)
    groups = molecules(table, rows)
    graph = BondGraph(table, rows) if use_bonds and table.bonds is not None else None
    loose = [group for group in groups if graph is None or not has_bonds(table, group)]
    check = StepCheck(table, candidate_pairs(table, loose), positions, cell, cut)
    chains: list[Chain] = []
    for group in groups:
        if graph is not None and has_bonds(table, group):
            found, remarks = bonded_chains(table, group, graph)
        else:
            found, remarks = _with_ends(table, ordered_chains(table, group, check), check, close_ends)
        chains += found
        notes += remarks
    if graph is not None:
        notes += _bridges(table, groups, graph)
    joined = [chain for chain in map(_without_singles, chains) if chain.runs]
    lone = _lone_rows(chains)
    if not joined:
        raise StrandError(_nothing_joined(table, lone))
    if len(lone):
        notes.append(f"Left out {counted(len(lone), 'atom')} joined to no other selected one: {table.census(lone)}.")
    return _assembled(table, joined, notes)


def _with_ends(
    table: AtomTable, chains: Sequence[Chain], check: StepCheck, close_ends: bool
) -> tuple[list[Chain], list[str]]:
    """Return the chains; where ends meet closed, or with a note if they are not to be closed."""
    meeting = [_ends_meet(chain, check) for chain in chains]
    if close_ends:
        pairs = zip(chains, meeting, strict=True)
        return [Chain([Run(c.runs[0].rows, closed=True)], []) if meet else c for c, meet in pairs], []
    # no hint for proteins: rings are rare among them, and ends that touch are not (BPTI's CA are 4.8 Å apart)
    rows = [chain.runs[0].rows[0] for chain, meet in zip(chains, meeting, strict=True) if meet]
    first_rows = [row for row in rows if table.residue_kind[row] != PROTEIN]
    return list(chains), [
        f"The ends of the strand from {table.label(row)} on are as near as neighbours; "
        "if it is a ring, pass --reader-option close_ends=yes."
        for row in first_rows
    ]


def _ends_meet(chain: Chain, check: StepCheck) -> bool:
    rows = chain.runs[0].rows
    return len(chain.runs) == 1 and len(rows) > CLOSED_MINIMUM and check.is_short(rows[-1], rows[0])


def _bridges(table: AtomTable, groups: Sequence[Indices], graph: BondGraph) -> list[str]:
    """Return a note on bonds between selected atoms of different molecules or chains, if there are any."""
    group_of = {row: number for number, group in enumerate(groups) for row in group.tolist()}
    bridges = [(i, j) for i, j in graph.direct_bonds() if group_of[i] != group_of[j]]
    if not bridges:
        return []
    first, second = (table.label(row) for row in bridges[0])
    return [
        f"Between molecules or chains there are {counted(len(bridges), 'bond')}, first {first} to {second}: no edges."
    ]


def _without_singles(chain: Chain) -> Chain:
    """Return the chain without runs of one vertex; a gap over such a run keeps its first reason."""
    kept = [k for k, run in enumerate(chain.runs) if len(run.rows) >= OPEN_MINIMUM]
    return Chain([chain.runs[k] for k in kept], [chain.reasons[k] for k in kept[:-1]])


def _lone_rows(chains: Sequence[Chain]) -> Indices:
    runs = (run.rows for chain in chains for run in chain.runs)
    return np.array(sorted(rows[0] for rows in runs if len(rows) < OPEN_MINIMUM), dtype=np.int64)


def _nothing_joined(table: AtomTable, lone: Indices) -> str:
    first = table.label(int(lone[0]))
    if len(lone) == 1:
        return f"The selection leaves a single vertex, {first}; a strand needs at least 2. Select more atoms."
    return (
        f"No two of the {len(lone)} selected atoms are joined ({table.census(lone)}), the first is {first}. "
        "Select backbone atoms, give a topology that holds bonds, or raise the cut."
    )


def _assembled(table: AtomTable, chains: Sequence[Chain], notes: Sequence[str]) -> Traces:
    runs = [run for chain in chains for run in chain.runs]
    order = np.array([row for run in runs for row in run.rows], dtype=np.int64)
    offsets = np.concatenate([[0], np.cumsum([len(run.rows) for run in runs])]).astype(np.int64)
    titles = _chain_titles(table, chains)
    labels = VertexLabels(
        chain=np.repeat(titles, [_size(c) for c in chains]).astype(np.str_),
        resid=table.resid[order],
        icode=table.icode[order],
        resname=table.resname[order],
        atom=table.name[order],
        atom_index=table.atom_index[order],
    )
    strands = Strands(
        offsets=offsets,
        closed=np.array([run.closed for run in runs], dtype=np.bool_),
        names=_strand_names(table, chains, titles),
        labels=labels,
        gaps=tuple(_gaps(chains)),
    )
    return Traces(order, strands, tuple(notes))


def _size(chain: Chain) -> int:
    return sum(len(run.rows) for run in chain.runs)


def _chain_titles(table: AtomTable, chains: Sequence[Chain]) -> list[str]:
    """Return one label for each chain: the file's own, numbered from the second of its name on."""
    labels = [table.group_label(chain.runs[0].rows[0]) for chain in chains]
    if len(chains) > 1:
        labels = [label or str(k) for k, label in enumerate(labels)]
    used: set[str] = set()
    count: Counter[str] = Counter()
    for k, label in enumerate(labels):
        while labels[k] in used:
            count[label] += 1
            labels[k] = f"{label}#{count[label] + 1}"
        used.add(labels[k])
    return labels


def _strand_names(table: AtomTable, chains: Sequence[Chain], titles: Sequence[str]) -> tuple[str, ...]:
    """Return the name of each strand: its chain's, with a range of residues where there are several."""
    names = []
    for chain, title in zip(chains, titles, strict=True):
        stem = _stem(table, chain, title)
        ranges = [f"{table.resid[run.rows[0]]}-{table.resid[run.rows[-1]]}" for run in chain.runs]
        names += [stem] if len(ranges) == 1 else [f"{stem} {residues}" for residues in ranges]
    return tuple(names)


def _stem(table: AtomTable, chain: Chain, title: str) -> str:
    row = chain.runs[0].rows[0]
    if table.chain[row] or table.segid[row]:
        return f"chain {title}"
    return f"molecule {title}" if table.molecule is not None else f"strand {title or 0}"


def _gaps(chains: Sequence[Chain]) -> Iterator[Gap]:
    last = -1
    for chain in chains:
        for run, reason in zip(chain.runs, [*chain.reasons, ""], strict=True):
            last += len(run.rows)
            if reason:
                yield Gap((last, last + 1), reason)
