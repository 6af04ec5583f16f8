"""Text to copy that opens the frames of an event in MDAnalysis, VMD and PyMOL."""

import json
from collections.abc import Sequence
from pathlib import PurePath


def snippets(paths: Sequence[str], frames: tuple[int, int], atoms: Sequence[int]) -> dict[str, str]:
    """Return the text for each program by its name; empty where the run was made from an object in memory.

    Parameters
    ----------
    paths : sequence of str
        Topology and trajectory.
    frames : tuple of int
        The two frames of the step, counted from 0.
    atoms : sequence of int
        0-based indices of the atoms to mark in the topology file.
    """
    if not paths:
        return {}
    if PurePath(paths[0]).suffix == ".npz":
        return {"NumPy": _numpy(paths[0], frames, atoms)}
    return {
        "MDAnalysis": _mdanalysis(paths, frames, atoms),
        "VMD": _vmd(paths, frames, atoms),
        "PyMOL": _pymol(paths, frames, atoms),
    }


def _numpy(path: str, frames: tuple[int, int], atoms: Sequence[int]) -> str:
    return (
        "import numpy as np\n"
        f"x = np.load({path!r})['positions']\n"
        f"before, after = x[{frames[0]}], x[{frames[1]}]\n"
        f"pair = {list(atoms)}"
    )


def _mdanalysis(paths: Sequence[str], frames: tuple[int, int], atoms: Sequence[int]) -> str:
    files = ", ".join(repr(path) for path in paths)
    lines = ["import MDAnalysis as mda", f"u = mda.Universe({files})"]
    lines += [f"pair = u.atoms[{list(atoms)}]"] if atoms else []
    shown = "pair.positions" if atoms else "u.atoms.positions"
    lines += [f"for frame in ({frames[0]}, {frames[1]}):", "    u.trajectory[frame]", f"    print(frame, {shown})"]
    return "\n".join(lines)


def _vmd(paths: Sequence[str], frames: tuple[int, int], atoms: Sequence[int]) -> str:
    topology, *trajectory = paths
    is_lammps = PurePath(topology).suffix in (".data", ".lammps")
    lines = ["package require topotools", f"topo readlammpsdata {{{topology}}}"] if is_lammps else []
    lines = lines or [f"mol new {{{topology}}} waitfor all"]
    if len(trajectory) == 1:  # two frames are enough, and a terabyte is not
        lines += ["animate delete all"]
        lines += [f"mol addfile {{{trajectory[0]}}} first {frames[0]} last {frames[1]} waitfor all", "animate goto 0"]
    else:
        lines += ["animate delete all"] if trajectory else []
        lines += [f"mol addfile {{{path}}} waitfor all" for path in trajectory] + [f"animate goto {frames[0]}"]
    if atoms:
        chosen = " ".join(map(str, atoms))
        lines += [f"mol selection {{index {chosen}}}", "mol representation VDW", "mol addrep top"]
    return "\n".join(lines)


def _pymol(paths: Sequence[str], frames: tuple[int, int], atoms: Sequence[int]) -> str:
    topology, *trajectory = paths
    lines = []
    if PurePath(topology).suffix in (".data", ".lammps", ".tpr"):
        lines = [f"# PyMOL does not read {PurePath(topology).suffix}: write a PDB of the first frame, and load that"]
    lines += [f"cmd.load({json.dumps(topology)}, 'run')"]
    if len(trajectory) == 1:
        window = f"state=1, start={frames[0] + 1}, stop={frames[1] + 1}"
        lines += [f"cmd.load_traj({json.dumps(trajectory[0])}, 'run', {window})", "cmd.frame(1)"]
    else:
        lines += [
            f"cmd.load_traj({json.dumps(path)}, 'run', state={0 if k else 1})" for k, path in enumerate(trajectory)
        ]
        lines += [f"cmd.frame({frames[0] + 1})"]
    if atoms:
        ranks = "+".join(map(str, atoms))
        lines += [f"cmd.select('pair', 'rank {ranks}')", "cmd.show('spheres', 'pair')", "cmd.zoom('pair', 8)"]
    return "\n".join(lines)
