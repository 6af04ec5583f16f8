"""Text to copy that opens the frames of an event in MDAnalysis, VMD and PyMOL.

The programs count differently: MDAnalysis and VMD number frames from 0, PyMOL numbers states from 1, and both viewers
number what they have loaded, not what the file holds. So each text loads the two frames alone where it can, and says
which is which.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from mdtopo.errors import OptionError
from mdtopo.readers.mdanalysis.options import Options

OPENING = ("topology_format", "format", "atom_style", "dt", "time_offset", "lengthunit", "timeunit")
"""Options of the MDAnalysis reader that its Universe takes by the same names."""

FOREIGN = {"VMD": (".tpr",), "PyMOL": (".data", ".lammps", ".tpr")}
"""Extensions of topologies that a program does not read, or not everywhere."""


def snippets(
    paths: Sequence[str], frames: tuple[int, int], atoms: Sequence[int], options: Mapping[str, Any] | None = None
) -> dict[str, str]:
    """Return the text for each program by its name; empty where the run was made from an object in memory.

    Parameters
    ----------
    paths : sequence of str
        Topology and trajectory.
    frames : tuple of int
        The two frames of the step, counted from 0.
    atoms : sequence of int
        0-based indices of the atoms to mark in the topology file.
    options : mapping, optional
        Reader options of the run, which MDAnalysis needs to open the files in the same way.
    """
    if not paths:
        return {}
    if PurePath(paths[0]).suffix == ".npz":
        return {"NumPy": _numpy(paths[0], frames, atoms)}
    return {
        "MDAnalysis": _mdanalysis(paths, frames, atoms, options or {}),
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


def _mdanalysis(paths: Sequence[str], frames: tuple[int, int], atoms: Sequence[int], options: Mapping[str, Any]) -> str:
    words = [repr(path) for path in paths] + [f"{name}={value!r}" for name, value in _keywords(options).items()]
    lines = ["import MDAnalysis as mda", f"u = mda.Universe({', '.join(words)})"]
    lines += [f"pair = u.atoms[{list(atoms)}]"] if atoms else []
    shown = "pair.positions" if atoms else "u.atoms.positions"
    lines += [f"for frame in ({frames[0]}, {frames[1]}):", "    u.trajectory[frame]", f"    print(frame, {shown})"]
    return "\n".join(lines)


def _keywords(options: Mapping[str, Any]) -> dict[str, Any]:
    try:
        found = Options.from_mapping(options)
    except OptionError:  # of another reader
        return {}
    flags = {"convert_units": False} if not found.convert_units else {}
    return found.chosen(*OPENING) | flags | ({"continuous": True} if found.continuous else {})


def _vmd(paths: Sequence[str], frames: tuple[int, int], atoms: Sequence[int]) -> str:
    topology, *trajectory = paths
    first, last = frames
    lines = _refusal("VMD", topology)
    if PurePath(topology).suffix in (".data", ".lammps"):
        lines += ["package require topotools", f"topo readlammpsdata {_tcl(topology)}"]
    else:
        lines += [f"mol new {_tcl(topology)} waitfor all"]
    # the topology file may hold a frame of its own, which would be number 0
    lines += ["animate delete all"] if trajectory else []
    if len(trajectory) == 1:  # two frames are enough, and a terabyte is not
        window = f"first {first} last {last} step {last - first}"
        lines += [f"mol addfile {_tcl(trajectory[0])} {window} waitfor all", "animate goto 0"]
        lines += [f"# VMD's frame 0 is frame {first} of the trajectory, its frame 1 is frame {last}"]
    else:
        lines += [f"mol addfile {_tcl(path)} waitfor all" for path in trajectory] + [f"animate goto {first}"]
        lines += [f"# VMD counts frames from 0, as mdtopo does: the step is from frame {first} to frame {last}"]
    if atoms:
        chosen = " ".join(map(str, atoms))
        lines += ["mol representation VDW", f"mol selection {{index {chosen}}}", "mol addrep top"]
    return "\n".join(lines)


def _tcl(path: str) -> str:
    """Return a path as one word of Tcl."""
    if not set(path) & set("{}\\"):
        return f"{{{path}}}"
    return '"' + "".join(f"\\{letter}" if letter in '"\\$[]{}' else letter for letter in path) + '"'


def _pymol(paths: Sequence[str], frames: tuple[int, int], atoms: Sequence[int]) -> str:
    topology, *trajectory = paths
    first, last = frames
    lines = [*_refusal("PyMOL", topology), f"cmd.load({json.dumps(topology)}, 'run')"]
    if len(trajectory) == 1:
        # one by one: PyMOL's interval skips frames before the first one too
        for state, frame in ((1, first), (2, last)):
            window = f"state={state}, start={frame + 1}, stop={frame + 1}"
            lines += [f"cmd.load_traj({json.dumps(trajectory[0])}, 'run', {window})"]
        lines += ["cmd.frame(1)", f"# PyMOL's state 1 is frame {first} of the trajectory, its state 2 is frame {last}"]
    else:
        lines += [
            f"cmd.load_traj({json.dumps(path)}, 'run', state={0 if k else 1})" for k, path in enumerate(trajectory)
        ]
        lines += [f"cmd.frame({first + 1})"]
        lines += [f"# PyMOL counts states from 1: the step is from state {first + 1} to state {last + 1}"]
    if atoms:
        ranks = "+".join(map(str, atoms))
        lines += [f"cmd.select('pair', 'rank {ranks}')", "cmd.show('spheres', 'pair')", "cmd.zoom('pair', 8)"]
    return "\n".join(lines)


def _refusal(program: str, topology: str) -> list[str]:
    suffix = PurePath(topology).suffix
    if suffix not in FOREIGN[program]:
        return []
    reads = f"not every {program} reads" if program == "VMD" else f"{program} does not read"
    return [f"# {reads} {suffix}: write a PDB or GRO file of the first frame then, and load that"]
