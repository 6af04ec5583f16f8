"""Systems that the benchmarks make: compact chains, and trajectories of them with or without other atoms around."""

from collections.abc import Iterator
from pathlib import Path

import MDAnalysis
import numpy as np
from MDAnalysis.coordinates.memory import MemoryReader
from numpy.typing import NDArray

from mdtopo import MonitorConfig

BOND = 3.8
"""Å, as between CA atoms."""

POLYLINE_ONLY = MonitorConfig(curve="none")
"""Settings of runs that leave the smooth curve out."""

STRAND_SPACING, SHEET_SPACING = 4.8, 7.4
"""Å, between neighbouring strands and between sheets: with BOND a residue has 135 Å³, as in folded proteins."""


def compact_chain(n: int) -> NDArray[np.float64]:
    """Return a chain of n vertices that fills a cube like a protein made of sheets, shape (n, 3), Å.

    It runs to and fro within a sheet, and from sheet to sheet, and never comes near itself; the bonds at its turns are
    as long as the spacings.
    """
    along = max(2, round((n * STRAND_SPACING * SHEET_SPACING / BOND**2) ** (1.0 / 3.0)))
    across = max(2, round(along * BOND / STRAND_SPACING))
    chain = np.empty((n, 3))
    for i in range(n):
        sheet, within = divmod(i, along * across + 1)  # the last one lies halfway to the next sheet
        strand, place = divmod(min(within, along * across - 1), along)
        up_sheet, up_strand = sheet % 2 == 0, (strand + sheet * across) % 2 == 0
        x = (place if up_strand else along - 1 - place) * BOND
        y = (strand if up_sheet else across - 1 - strand) * STRAND_SPACING
        chain[i] = x, y, (sheet + 0.5 * (within == along * across)) * SHEET_SPACING
    return chain


def random_chain(n_edges: int, seed: int = 0) -> NDArray[np.float64]:
    """Return a random walk that is kept in a cube, one vertex in 135 Å³ as in folded proteins, shape (n + 1, 3), Å.

    It does not avoid itself, so a random motion makes some edges pass through each other.
    """
    rng = np.random.default_rng(seed)
    edge = (n_edges * BOND * STRAND_SPACING * SHEET_SPACING) ** (1.0 / 3.0)
    chain, here, k = [np.full(3, edge / 2)], np.full(3, edge / 2), 0
    while len(chain) <= n_edges:
        if k % 4096 == 0:
            bonds = rng.normal(size=(4096, 3))
            bonds *= BOND / np.linalg.norm(bonds, axis=1, keepdims=True)
        there = here + bonds[k % 4096]
        k += 1
        if there.min() >= 0.0 and there.max() <= edge:
            chain.append(there)
            here = there
    return np.array(chain)


def self_avoiding_chain(n_edges: int, seed: int = 0) -> NDArray[np.float64]:
    """Return a random walk that visits each site of a cubic lattice once, its sites BOND apart, shape (n + 1, 3), Å.

    As dense as a chain can be on a lattice: the sites of each cube of eight are joined to a ring, one of the six there
    are, and rings of cubes that lie side by side are joined along a random tree, by two bonds in place of two parallel
    ones. The walk follows the one ring that results.
    """
    rng = np.random.default_rng(seed)
    m = int(np.ceil(((n_edges + 1) / 8.0) ** (1.0 / 3.0) - 1e-9))
    weights = np.array([4 * m * m, 2 * m, 1])
    corners = 2 * np.stack(np.meshgrid(*[np.arange(m)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    rings = np.array(list(_cube_rings()))
    sites = (corners[:, np.newaxis] + rings[rng.integers(len(rings), size=m**3)]) @ weights
    beside = np.empty((8 * m**3, 2), dtype=np.int64)
    beside[sites, 0], beside[sites, 1] = np.roll(sites, 1, axis=1), np.roll(sites, -1, axis=1)
    tree = list(range(m**3))

    def root(cube: int) -> int:
        while tree[cube] != cube:
            tree[cube] = cube = tree[tree[cube]]
        return cube

    for cube, axis in rng.permutation([(cube, axis) for cube in range(m**3) for axis in range(3)]):
        other = cube + (m * m, m, 1)[axis]
        if corners[cube, axis] == 2 * m - 2 or root(cube) == root(other):
            continue
        here, step = (corners[cube] @ weights) + weights[axis], weights[axis]
        across = [w for k, w in enumerate(weights) if k != axis]
        bonds = [(here + far, here + far + along) for along, side in (across, across[::-1]) for far in (0, side)]
        for p, q in rng.permutation(bonds):
            if q in beside[p] and q + step in beside[p + step]:
                for a, b in ((p, q), (q, p)):
                    beside[a, list(beside[a]).index(b)] = a + step
                    beside[a + step, list(beside[a + step]).index(b + step)] = a
                tree[root(cube)] = root(other)
                break
    before, here, path = -1, 0, []
    while len(path) <= n_edges:
        path.append(here)
        before, here = here, int(beside[here, 0] if beside[here, 0] != before else beside[here, 1])
    return BOND * np.stack(np.unravel_index(path, (2 * m, 2 * m, 2 * m)), axis=1).astype(np.float64)


def _cube_rings() -> Iterator[list[tuple[int, int, int]]]:
    """Yield the ways around the corners of a cube that visit each once, from the first corner."""
    paths = [[(0, 0, 0)]]
    while paths:
        path = paths.pop()
        x, y, z = path[-1]
        nexts = [(1 - x, y, z), (x, 1 - y, z), (x, y, 1 - z)]
        if len(path) == 8 and path[0] in nexts:
            yield path
        paths += [[*path, corner] for corner in nexts if corner not in path]


def displaced(chain: NDArray[np.float64], share: float, seed: int = 1) -> NDArray[np.float64]:
    """Return the chain with every vertex moved by that share of an edge, in a random direction."""
    away = np.random.default_rng(seed).normal(size=chain.shape)
    return chain + share * BOND * away / np.linalg.norm(away, axis=1, keepdims=True)


def jiggled(chain: NDArray[np.float64], n_frames: int, step: float, seed: int = 2) -> NDArray[np.float32]:
    """Return frames in which every vertex moves by about `step` Å at random from one to the next, near its place."""
    return np.stack(list(jiggles(chain, n_frames, step, seed)))


def jiggles(chain: NDArray[np.float64], n_frames: int, step: float, seed: int = 2) -> Iterator[NDArray[np.float32]]:
    """Yield the frames of `jiggled` one by one."""
    rng = np.random.default_rng(seed)
    away = np.zeros(chain.shape)
    for _ in range(n_frames):
        away = 0.9 * away + rng.normal(scale=step / np.sqrt(3.0), size=chain.shape)
        yield (chain + away).astype(np.float32)


def write_trajectory(folder: Path, n_backbone: int, n_atoms: int, n_frames: int) -> tuple[Path, Path]:
    """Write a PDB-like GRO topology and an XTC: CA backbone atoms first, water oxygens around; return their paths."""
    chain = compact_chain(n_backbone)
    rng = np.random.default_rng(3)
    n_water = n_atoms - n_backbone
    edge = max(200.0, (n_atoms * 10.0) ** (1.0 / 3.0))
    water = rng.uniform(0.0, edge, size=(n_water, 3))
    universe = MDAnalysis.Universe.empty(n_atoms, n_residues=n_atoms, atom_resindex=np.arange(n_atoms), trajectory=True)
    universe.add_TopologyAttr("names", ["CA"] * n_backbone + ["OW"] * n_water)
    universe.add_TopologyAttr("resnames", ["ALA"] * n_backbone + ["SOL"] * n_water)
    universe.add_TopologyAttr("resids", (np.arange(n_atoms) % 99_999) + 1)
    topology, trajectory = folder / f"system_{n_atoms}.gro", folder / f"system_{n_atoms}.xtc"
    universe.load_new(np.concatenate([chain + edge / 4, water])[np.newaxis], format=MemoryReader)
    universe.dimensions = [edge, edge, edge, 90.0, 90.0, 90.0]
    universe.atoms.write(str(topology))
    with MDAnalysis.Writer(str(trajectory), n_atoms=n_atoms) as writer:
        for k, frame in enumerate(jiggles(chain, n_frames, step=0.5)):
            moved = water + rng.normal(scale=0.5, size=water.shape)
            universe.atoms.positions = np.concatenate([frame + edge / 4, moved])
            universe.trajectory.ts.time = universe.trajectory.ts.data["time"] = float(k)
            writer.write(universe.atoms)
    return topology, trajectory
