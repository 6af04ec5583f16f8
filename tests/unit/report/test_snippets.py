"""What is copied from a page opens the two frames of the step, and no others, in each program."""

import json
import subprocess
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mdtopo.readers import ReaderRequest, Source
from mdtopo.readers.mdanalysis import MDAnalysisReader
from mdtopo.report.snippets import snippets

N_ATOMS, N_FRAMES = 6, 9
STEPS = ((0, 1), (3, 4), (2, 7))
"""Neighbours, and a step of a run with --frames 2::5."""

ATOM_STYLE = "id type x y z"


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    """Return the path of a file by its name: every format holds the same frames, in its own precision."""
    import MDAnalysis

    folder = tmp_path_factory.mktemp("files of a run")
    rng = np.random.default_rng(3)
    x = 10.0 + np.cumsum(rng.normal(0.0, 1.0, (N_FRAMES, N_ATOMS, 3)), axis=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        universe = MDAnalysis.Universe.empty(N_ATOMS, N_ATOMS, atom_resindex=range(N_ATOMS), trajectory=True)
        for name, value in {"name": "CA", "type": "C", "element": "C", "chainID": "A", "resname": "GLY"}.items():
            universe.add_TopologyAttr(name, [value] * N_ATOMS)
        universe.add_TopologyAttr("segid", ["A"])
        universe.add_TopologyAttr("resid", range(1, N_ATOMS + 1))
        universe.dimensions = [60.0, 60.0, 60.0, 90.0, 90.0, 90.0]

        def write(name: str, frames: Sequence[int], **more: Any) -> None:
            with MDAnalysis.Writer(str(folder / name), n_atoms=N_ATOMS, **more) as file:
                for k in frames:
                    universe.atoms.positions = x[k]
                    universe.trajectory.ts.time = universe.trajectory.ts.frame = k
                    file.write(universe.atoms)

        for kind in ("xtc", "trr", "dcd", "xyz", "ncdf"):
            write(f"run.{kind}", range(N_FRAMES))
        write("run.pdb", range(N_FRAMES), multiframe=True)
        write("top.gro", [8])
        write("top.pdb", [8], multiframe=False)
        write("part1.xtc", range(4))
        write("part2.xtc", range(4, N_FRAMES))
    rows = [f"{k + 1} 1 {a:.6f} {b:.6f} {c:.6f}" for k, (a, b, c) in enumerate(x[8])]
    box = "\n".join(f"0 60 {axis}lo {axis}hi" for axis in "xyz")
    head = f"beads\n\n{N_ATOMS} atoms\n1 atom types\n\n{box}\n\nMasses\n\n1 1.0\n\nAtoms\n"
    (folder / "top.data").write_text("\n".join([head, *rows]) + "\n")
    return lambda name: str(folder / name)


INPUTS: dict[str, tuple[list[str], dict[str, str]]] = {
    "pdb alone": (["run.pdb"], {}),
    "gro xtc": (["top.gro", "run.xtc"], {}),
    "gro trr": (["top.gro", "run.trr"], {}),
    "pdb dcd": (["top.pdb", "run.dcd"], {}),
    "pdb xyz": (["top.pdb", "run.xyz"], {}),
    "pdb ncdf": (["top.pdb", "run.ncdf"], {}),
    "gro in parts": (["top.gro", "part1.xtc", "part2.xtc"], {}),
    "data dcd": (["top.data", "run.dcd"], {"atom_style": ATOM_STYLE, "dt": "0.5"}),
    "data with units": (["top.data", "run.dcd"], {"atom_style": ATOM_STYLE, "format": "LAMMPS", "lengthunit": "nm"}),
}


def as_read(paths: list[str], options: dict[str, str], frame: int) -> np.ndarray:
    """Return the positions of a frame as a run reads them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reader = MDAnalysisReader.open(Source(paths=tuple(map(Path, paths))), ReaderRequest("all", options))
        with reader:
            (found,) = reader.frames(frame, frame + 1, 1)
    assert found.index == frame
    return found.positions


@pytest.mark.parametrize("kind", INPUTS)
@pytest.mark.parametrize("frames", STEPS)
def test_mdanalysis_opens_what_the_run_has_read(
    files: Callable[[str], str], kind: str, frames: tuple[int, int], capsys: pytest.CaptureFixture[str]
) -> None:
    names, options = INPUTS[kind]
    paths = [files(name) for name in names]
    text = snippets(paths, frames, [1, 2, 4, 5], options)["MDAnalysis"]
    shown: list[tuple[int, np.ndarray]] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exec(compile(text, "snippet", "exec"), {"print": lambda frame, x: shown.append((frame, x.copy()))})
    assert [frame for frame, _ in shown] == list(frames)
    for frame, x in shown:
        np.testing.assert_array_equal(x.astype(np.float64), as_read(paths, options, frame)[[1, 2, 4, 5]])


class Vmd:
    """Keeps what the commands of VMD would load, by their description in its user's guide: frames count from 0."""

    def __init__(self) -> None:
        self.frames: list[tuple[str, int]] = []
        self.shown, self.rep = -1, {}
        self.selections: list[str] = []

    def run(self, text: str) -> None:
        from tkinter import Tcl

        tcl = Tcl()
        for name in ("mol", "animate", "topo"):
            tcl.createcommand(name, getattr(self, name))
        tcl.eval("proc package args {}")
        tcl.eval(text)

    def mol(self, what: str, *words: str) -> str:
        if what in ("new", "addfile"):
            path, options = words[0], dict(zip(words[1::2], words[2::2], strict=True))
            assert set(options) <= {"first", "last", "step", "waitfor"}
            assert options["waitfor"] == "all"
            count = 1 if Path(path).name.startswith("top") else 4 if "part1" in path else 5 if "part2" in path else 9
            first, last, step = (
                int(options.get(key, default))
                for key, default in zip(("first", "last", "step"), (0, count - 1, 1), strict=True)
            )
            self.frames += [(path, k) for k in range(first, last + 1, step)]
        elif what in ("representation", "selection"):
            self.rep[what] = " ".join(words)
        else:
            assert (what, words) == ("addrep", ("top",))
            self.selections.append(self.rep["selection"])
        return ""

    def animate(self, what: str, word: str) -> str:
        if what == "delete":
            assert word == "all"
            self.frames.clear()
        else:
            assert what == "goto"
            self.shown = int(word)
        return ""

    def topo(self, what: str, path: str) -> str:
        assert what == "readlammpsdata"
        self.frames.append((path, 0))
        return ""


@pytest.mark.skipif(find_spec("tkinter") is None, reason="Tcl is not installed")
@pytest.mark.parametrize("kind", INPUTS)
@pytest.mark.parametrize("frames", STEPS)
def test_vmd_is_told_to_load_the_two_frames(files: Callable[[str], str], kind: str, frames: tuple[int, int]) -> None:
    paths = [files(name) for name in INPUTS[kind][0]]
    vmd = Vmd()
    vmd.run(snippets(paths, frames, [1, 2, 4, 5])["VMD"])
    every = [
        (path, k) for path in (paths[1:] or paths) for k in range({"part1": 4, "part2": 5}.get(Path(path).stem, 9))
    ]
    if len(paths) == 2:  # these two and no others
        assert vmd.frames == [every[frames[0]], every[frames[1]]]
        assert vmd.shown == 0
    else:
        assert vmd.frames == every
        assert vmd.shown == frames[0]
    assert vmd.selections == ["index 1 2 4 5"]


@pytest.mark.skipif(find_spec("tkinter") is None, reason="Tcl is not installed")
@pytest.mark.parametrize("name", ["a b.pdb", "a}b.pdb", "{.pdb", 'q"[exit]$x\\.pdb'])
def test_a_path_is_one_word_of_tcl(name: str) -> None:
    vmd = Vmd()
    vmd.run(snippets([f"/x/{name}"], (3, 4), [])["VMD"])
    assert vmd.frames[0][0] == f"/x/{name}"


@pytest.mark.skipif(find_spec("pymol2") is None, reason="PyMOL is not installed")
@pytest.mark.parametrize("kind", [kind for kind in INPUTS if "data" not in kind and "ncdf" not in kind])
@pytest.mark.parametrize("frames", STEPS)
def test_pymol_shows_the_two_frames(files: Callable[[str], str], kind: str, frames: tuple[int, int]) -> None:
    paths = [files(name) for name in INPUTS[kind][0]]
    text = snippets(paths, frames, [1, 2, 4, 5])["PyMOL"]
    states = (1, 2) if len(paths) == 2 else (frames[0] + 1, frames[1] + 1)
    program = (
        "import json, sys, pymol2\n"
        "with pymol2.PyMOL() as p:\n"
        "    cmd = p.cmd\n"
        "    cmd.feedback('disable', 'all', 'everything')\n"
        "    exec(sys.stdin.read())\n"
        f"    x = [[a.coord for a in cmd.get_model('pair', state).atom] for state in {states}]\n"
        "    print('found', json.dumps([x, cmd.get_state(), cmd.count_states('run')]))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], input=text, capture_output=True, text=True, check=True)
    line = next(line for line in done.stdout.splitlines() if line.startswith("found"))
    positions, shown, count = json.loads(line.removeprefix("found"))
    assert shown == states[0]
    assert count == (2 if len(paths) == 2 else N_FRAMES)
    for frame, x in zip(frames, positions, strict=True):
        np.testing.assert_allclose(x, as_read(paths, {}, frame)[[1, 2, 4, 5]], atol=1e-3)


def test_what_a_program_does_not_read_is_said() -> None:
    found = snippets(["/x/md.tpr", "/x/md.xtc"], (0, 1), [0, 1])
    assert "not every VMD reads .tpr" in found["VMD"]
    assert "PyMOL does not read .tpr" in found["PyMOL"]
    assert "does not read" not in found["MDAnalysis"]
    assert "PyMOL does not read .data" in snippets(["/x/top.data", "/x/run.dcd"], (0, 1), [0])["PyMOL"]
    assert list(snippets(["/x/run.npz"], (0, 1), [0])) == ["NumPy"]
    assert snippets([], (0, 1), [0]) == {}
