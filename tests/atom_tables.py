"""Small tables of atoms for tests of the strand rules."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from mdtopo.strands import AtomTable, Traces


def residue_table(resids, *, name="CA", resname="ALA", kind="protein", size=10, chain="", segid="", **columns):
    """Return a table with one atom in each residue, of residues with `size` atoms; strings are broadcast."""
    n = len(resids)
    columns |= {"name": name, "resname": resname, "residue_kind": kind, "chain": chain, "segid": segid}
    arrays = {key: np.broadcast_to(np.asarray(value), n).copy() for key, value in columns.items()}
    return replace(
        AtomTable.beads(n),
        resid=np.asarray(resids, dtype=np.int64),
        residue_size=np.broadcast_to(np.asarray(size), n).copy(),
        **arrays,
    )


def chain_bonds(*chains, closed=False):
    """Return the bonds along chains of atom indices."""
    bonds = [pair for atoms in chains for pair in pairwise(atoms)]
    bonds += [(atoms[-1], atoms[0]) for atoms in chains if closed]
    return np.array(bonds, dtype=np.int64).reshape(-1, 2)


def line(n, step=3.8):
    """Return positions along x, Å."""
    return np.stack([step * np.arange(n), np.zeros(n), np.zeros(n)], axis=1)


def strand_atoms(traces: Traces):
    """Return the file indices of each strand's atoms, in order."""
    index, offsets = traces.strands.labels.atom_index, traces.strands.offsets
    return [index[a:b].tolist() for a, b in pairwise(offsets)]


def edge_atoms(traces: Traces):
    """Return the edges as a set of pairs of file indices, without direction."""
    index = traces.strands.labels.atom_index
    return {frozenset(index[list(edge)].tolist()) for edge in traces.strands.edges}
