"""Frames of an XTC file that are read below the Universe are those of the Universe, bit for bit."""

import warnings

import MDAnalysis
import numpy as np
import pytest
from MDAnalysis.lib.formats.libmdaxdr import XTCFile

from mdtopo.errors import TrajectoryError
from mdtopo.readers import ReaderRequest, Source
from mdtopo.readers.mdanalysis import MDAnalysisReader
from mdtopo.readers.mdanalysis import reader as reader_module
from mdtopo.readers.mdanalysis.opening import open_files, open_object
from mdtopo.readers.mdanalysis.options import Options
from mdtopo.readers.mdanalysis.reader import read_frame
from mdtopo.readers.mdanalysis.xtc import xtc_frames

BOXES = {
    "square": lambda k: (40.0, 41.0, 42.0, 90.0, 90.0, 90.0),
    "slanted": lambda k: (40.0, 40.0, 40.0, 60.0, 70.0, 80.0),
    "breathing": lambda k: (40.0 + 0.1 * k, 41.0, 42.0, 90.0, 90.0, 90.0),
    "none": lambda k: None,
    "now and then": lambda k: (40.0, 40.0, 40.0, 90.0, 90.0, 90.0) if k % 2 else None,
}


def written(folder, n_atoms=50, box=BOXES["square"]):
    """Write a topology, and five frames with times that are no whole numbers; return their paths."""
    topology, trajectory = folder / "model.gro", folder / "model.xtc"
    universe = MDAnalysis.Universe.empty(n_atoms, n_residues=n_atoms, atom_resindex=np.arange(n_atoms), trajectory=True)
    for name, values in (("names", ["CA"] * n_atoms), ("resnames", ["ALA"] * n_atoms)):
        universe.add_TopologyAttr(name, values)
    rng = np.random.default_rng(n_atoms)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        universe.atoms.write(str(topology))
        with MDAnalysis.Writer(str(trajectory), n_atoms=n_atoms) as file:
            for k in range(5):
                universe.atoms.positions = rng.normal(size=(n_atoms, 3), scale=20.0)
                universe.dimensions = box(k)
                universe.trajectory.ts.time = 0.3 * k + 0.1
                file.write(universe.atoms)
    return topology, trajectory


def opened(files, **options):
    return open_files(Source(paths=files), Options.from_mapping(options))


def assert_same(frame, other):
    assert (frame.index, frame.time) == (other.index, other.time)
    assert frame.positions.dtype == np.float64
    assert frame.positions.tobytes() == other.positions.tobytes()
    assert frame.positions.flags["C_CONTIGUOUS"]
    assert frame.positions.flags["OWNDATA"]
    assert (frame.cell is None) == (other.cell is None)
    assert frame.cell is None or frame.cell.tobytes() == other.cell.tobytes()


class TestSameFrames:
    @pytest.mark.parametrize("box", BOXES.values(), ids=BOXES)
    @pytest.mark.parametrize("atoms", [slice(0, 50), slice(3, 20), np.array([4, 2, 40])], ids=["all", "some", "apart"])
    def test_they_are_those_of_the_universe(self, tmp_path, box, atoms):
        files = opened(written(tmp_path, box=box))
        direct = xtc_frames(files, atoms)
        for index in (0, 1, 2, 3, 4, 2, 0, 4):
            assert_same(direct.frame(index), read_frame(files, index, atoms))

    def test_fewer_than_ten_atoms_are_stored_as_they_are(self, tmp_path):
        files = opened(written(tmp_path, n_atoms=7))
        direct = xtc_frames(files, slice(0, 7))
        for index in range(5):
            assert_same(direct.frame(index), read_frame(files, index, slice(0, 7)))

    def test_frames_keep_what_they_hold(self, tmp_path):
        files = opened(written(tmp_path))
        direct = xtc_frames(files, slice(0, 50))
        frames = [direct.frame(k) for k in range(5)]
        for index, frame in enumerate(frames):
            assert_same(frame, read_frame(files, index, slice(0, 50)))


class TestWhatIsLeftToTheUniverse:
    @pytest.mark.parametrize(
        "options", [{"dt": "2"}, {"time_offset": "5"}, {"convert_units": "no"}], ids=["dt", "time_offset", "units"]
    )
    def test_other_times_and_units(self, tmp_path, options):
        assert xtc_frames(opened(written(tmp_path), **options), slice(0, 50)) is None

    def test_a_universe_that_was_passed(self, tmp_path):
        universe = MDAnalysis.Universe(*map(str, written(tmp_path)))
        assert xtc_frames(open_object(Source(object=universe)), slice(0, 50)) is None

    def test_several_parts(self, tmp_path):
        topology, trajectory = written(tmp_path)
        assert xtc_frames(opened((topology, trajectory, trajectory)), slice(0, 50)) is None

    def test_another_format(self, tmp_path):
        topology, _ = written(tmp_path)
        assert xtc_frames(opened((topology,)), slice(0, 50)) is None

    def test_numbers_that_overflow_in_angstrom(self, tmp_path):
        topology, trajectory = written(tmp_path, n_atoms=7)
        with XTCFile(str(trajectory), "w") as file:
            for size in (1.0, 1e38):
                file.write(np.full((7, 3), size, np.float32), np.eye(3, dtype=np.float32), 0, 0.0)
        direct = xtc_frames(opened((topology, trajectory)), slice(0, 7))
        assert direct.frame(0) is not None
        assert direct.frame(1) is None


class TestDamage:
    def test_a_frame_that_cannot_be_read_ends_the_frames_as_it_did(self, tmp_path, monkeypatch):
        topology, trajectory = written(tmp_path)
        content = bytearray(trajectory.read_bytes())
        third = opened((topology, trajectory)).universe.trajectory._xdr.offsets[3]
        content[third : third + 4] = b"\0\0\0\0"  # no longer the number that each frame begins with
        trajectory.write_bytes(content)

        def read():
            found = []
            with MDAnalysisReader.open(Source(paths=(topology, trajectory)), ReaderRequest("name CA")) as reader:
                try:
                    found.extend(reader.frames())
                except TrajectoryError as error:
                    return found, str(error)
            return found, ""

        frames, words = read()
        monkeypatch.setattr(reader_module, "xtc_frames", lambda *_: None)
        others, same_words = read()
        assert words == same_words
        assert len(frames) == len(others)
        for frame, other in zip(frames, others, strict=True):
            assert_same(frame, other)

    def test_a_closed_file_gives_no_frame(self, tmp_path):
        files = opened(written(tmp_path))
        direct = xtc_frames(files, slice(0, 50))
        files.universe.trajectory.close()
        assert direct.frame(1) is None
