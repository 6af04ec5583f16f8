"""Damaged, mismatched and unknown files: each ends in one sentence that names the file."""

import warnings
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from mdtopo.errors import (
    InputError,
    MissingDependencyError,
    MissingFileError,
    OptionError,
    TrajectoryError,
    UnknownFormatError,
)
from mdtopo.readers import ReaderRequest, Source
from mdtopo.readers.mdanalysis import MDAnalysisReader
from mdtopo.readers.mdanalysis.extensions import EXTENSIONS, has_known_extension

FIXTURES = Path(__file__).parents[4] / "fixtures" / "strands"
MEMBRANE = FIXTURES / "membrane.gro"
N_FRAMES = 4


def opened(*paths, **options):
    return MDAnalysisReader.open(Source(paths=tuple(map(Path, paths))), ReaderRequest("name CA", options))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Trajectories of the membrane in several formats, by extension."""
    import MDAnalysis

    folder = tmp_path_factory.mktemp("whole")
    rng = np.random.default_rng(1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        universe = MDAnalysis.Universe(str(MEMBRANE))
        for kind in ("xtc", "trr", "dcd", "xyz", "pdb", "ncdf", "gro"):
            more = {"multiframe": True} if kind == "pdb" else {}
            with MDAnalysis.Writer(str(folder / f"run.{kind}"), n_atoms=45, **more) as file:
                for _ in range(1 if kind == "gro" else N_FRAMES):
                    universe.atoms.positions += rng.normal(size=(45, 3))
                    universe.dimensions = [40.0, 40.0, 30.0, 90.0, 90.0, 90.0]
                    file.write(universe.atoms)
    return lambda kind: folder / f"run.{kind}"


@pytest.fixture
def cut(whole, tmp_path):
    """Return a trajectory without its last bytes."""

    def shortened(kind, n_bytes):
        path = tmp_path / f"short.{kind}"
        path.write_bytes(whole(kind).read_bytes()[:-n_bytes])
        return path

    return shortened


def one_sentence(error):
    text = str(error.value)
    assert "\n" not in text
    assert "Traceback" not in text
    assert text.endswith(".")
    return text


class TestCutOff:
    @pytest.mark.parametrize("kind", ["xtc", "trr", "dcd", "xyz", "pdb"])
    def test_a_file_that_ends_within_its_last_frame_is_read_up_to_it(self, cut, whole, kind):
        n_bytes = whole(kind).stat().st_size // (2 * N_FRAMES)
        path = cut(kind, n_bytes)
        with opened(MEMBRANE, path) as reader:
            frames = reader.frames()
            assert [frame.index for frame in islice(frames, N_FRAMES - 1)] == [0, 1, 2]
            with pytest.raises(TrajectoryError, match=f"(?i)frame 3.*cut off.*:{N_FRAMES - 1}") as error:
                next(frames)
            assert str(path) in one_sentence(error)

    @pytest.mark.parametrize("kind", ["xtc", "trr", "dcd", "xyz", "pdb"])
    def test_the_frames_before_can_be_read_as_the_message_says(self, cut, whole, kind):
        path = cut(kind, whole(kind).stat().st_size // (2 * N_FRAMES))
        with opened(MEMBRANE, path) as reader:
            assert len(list(reader.frames(None, N_FRAMES - 1))) == N_FRAMES - 1

    @pytest.mark.parametrize("kind", ["xtc", "trr", "dcd", "xyz", "pdb"])
    @pytest.mark.parametrize("stop", [None, -1, 9])
    def test_a_stride_over_the_frame_of_the_cut_ends_with_the_error_too(self, cut, whole, kind, stop):
        path = cut(kind, whole(kind).stat().st_size // (2 * N_FRAMES))
        with opened(MEMBRANE, path) as reader:
            frames = reader.frames(None, stop, 2)
            assert [frame.index for frame in islice(frames, 2)] == [0, 2]
            with pytest.raises(TrajectoryError, match=r"(?i)frame 3.*cut off"):
                next(frames)

    @pytest.mark.parametrize("kind", ["xtc", "dcd"])
    def test_a_stride_that_ends_before_the_cut_is_read_to_its_end(self, cut, whole, kind):
        path = cut(kind, whole(kind).stat().st_size // (2 * N_FRAMES))
        with opened(MEMBRANE, path) as reader:
            assert [frame.index for frame in reader.frames(None, 3, 2)] == [0, 2]

    @pytest.mark.parametrize("kind", ["xtc", "trr", "dcd", "xyz", "ncdf"])
    def test_a_stride_over_a_whole_file_is_read_to_its_end(self, whole, kind):
        with opened(MEMBRANE, whole(kind)) as reader:
            assert [frame.index for frame in reader.frames(None, None, 2)] == [0, 2]

    @pytest.mark.parametrize("kind", ["xtc", "trr", "dcd", "xyz", "ncdf"])
    def test_a_whole_file_is_read_to_its_end(self, whole, kind):
        with opened(MEMBRANE, whole(kind)) as reader:
            assert [frame.index for frame in reader.frames()] == [0, 1, 2, 3]

    @pytest.mark.parametrize("left", [1, 4, 40, 91, 92, 150])
    @pytest.mark.parametrize("kind", ["xtc", "trr"])
    def test_a_cut_within_the_head_of_a_frame_is_seen(self, cut, whole, kind, left):
        """MDAnalysis does not count a frame of which less is there than its head."""
        import MDAnalysis

        universe = MDAnalysis.Universe(str(MEMBRANE), str(whole(kind)))
        last = int(universe.trajectory._xdr.offsets[-1])
        path = cut(kind, whole(kind).stat().st_size - last - left)
        with opened(MEMBRANE, path) as reader:
            frames = reader.frames()
            assert [frame.index for frame in islice(frames, N_FRAMES - 1)] == [0, 1, 2]
            with pytest.raises(TrajectoryError, match=r"(?i)frame 3.*cut off"):
                next(frames)
        with opened(MEMBRANE, cut(kind, whole(kind).stat().st_size - last)) as reader:
            assert len(list(reader.frames())) == N_FRAMES - 1

    def test_one_byte_is_enough(self, cut):
        with (
            opened(MEMBRANE, cut("dcd", 1)) as reader,
            pytest.raises(TrajectoryError, match="within frame 3"),
        ):
            list(reader.frames())

    def test_a_dcd_that_lacks_whole_frames_has_a_note(self, cut):
        bytes_per_frame = 3 * (4 * 45 + 8) + 56
        with opened(MEMBRANE, cut("dcd", bytes_per_frame)) as reader:
            assert len(list(reader.frames())) == N_FRAMES - 1
            assert any(f"declares {N_FRAMES} frames, but the file holds 3" in note for note in reader.notes)

    @pytest.mark.parametrize("kind", ["xtc", "trr", "dcd", "xyz", "pdb", "ncdf", "gro"])
    def test_a_file_that_ends_within_its_first_frame_is_refused(self, whole, tmp_path, kind):
        path = tmp_path / f"short.{kind}"
        path.write_bytes(whole(kind).read_bytes()[:300])
        with pytest.raises(TrajectoryError, match=str(path)) as error:
            opened(MEMBRANE, path)
        one_sentence(error)

    def test_a_first_part_that_is_cut_off_is_refused(self, cut, whole):
        with pytest.raises(TrajectoryError, match="not the last part, is cut off within frame 3"):
            opened(MEMBRANE, cut("dcd", 10), whole("dcd"))

    def test_a_last_part_that_is_cut_off_is_read_up_to_it(self, cut, whole):
        with opened(MEMBRANE, whole("dcd"), cut("dcd", 10)) as reader:
            frames = reader.frames()
            assert len(list(islice(frames, 7))) == 7
            with pytest.raises(TrajectoryError, match="within frame 7"):
                next(frames)


class TestSwapped:
    @pytest.mark.parametrize("kind", ["xtc", "trr", "dcd"])
    def test_frames_for_the_topology_and_atoms_for_the_trajectory_are_refused(self, whole, kind):
        with pytest.raises(InputError, match="are the two files swapped") as error:
            opened(whole(kind), MEMBRANE)
        assert str(whole(kind)) in one_sentence(error)


class TestMismatch:
    @pytest.mark.parametrize("kind", ["xtc", "trr", "dcd", "xyz", "pdb", "ncdf", "gro"])
    def test_both_numbers_of_atoms_are_named(self, whole, kind):
        with pytest.raises(TrajectoryError, match=r"has 45 atoms, but the topology .*traps\.pdb has 14") as error:
            opened(FIXTURES / "traps.pdb", whole(kind))
        one_sentence(error)

    def test_the_part_that_differs_is_named(self, whole):
        with pytest.raises(TrajectoryError, match=r"traps\.pdb has 14 atoms, but the topology .*gro has 45"):
            opened(MEMBRANE, whole("dcd"), FIXTURES / "traps.pdb")


class TestUnreadable:
    def test_a_missing_file(self):
        with pytest.raises(MissingFileError, match=r"nowhere.dcd does not exist"):
            opened(MEMBRANE, "nowhere.dcd")

    @pytest.mark.parametrize("name", ["empty.gro", "empty.xtc"])
    def test_an_empty_file(self, tmp_path, name):
        (tmp_path / name).touch()
        paths = [tmp_path / name] if name.endswith("gro") else [MEMBRANE, tmp_path / name]
        with pytest.raises(TrajectoryError, match=f"{name} is empty"):
            opened(*paths)

    @pytest.mark.parametrize("kind", ["gro", "pdb", "psf", "data", "tpr", "prmtop", "xyz"])
    def test_a_topology_that_is_none(self, tmp_path, whole, kind):
        path = tmp_path / f"text.{kind}"
        path.write_text("hello world\n" * 100)
        with pytest.raises(InputError, match=f"text.{kind} cannot be read as a topology") as error:
            opened(path, whole("dcd"))
        one_sentence(error)

    @pytest.mark.parametrize("kind", ["xtc", "trr", "dcd", "ncdf", "xyz", "gro"])
    def test_a_trajectory_that_is_none(self, tmp_path, kind):
        path = tmp_path / f"text.{kind}"
        path.write_text("hello world\n" * 100)
        with pytest.raises(TrajectoryError, match=f"text.{kind} cannot be read as a trajectory") as error:
            opened(MEMBRANE, path)
        one_sentence(error)

    def test_a_topology_without_coordinates(self):
        datafiles = pytest.importorskip("MDAnalysisTests.datafiles")
        with pytest.raises(InputError, match="holds no coordinates; pass a trajectory file after it"):
            opened(datafiles.PSF)

    def test_a_missing_package(self, whole, monkeypatch):
        from MDAnalysis.coordinates.XTC import XTCReader

        def lacking(*_, **__):
            raise ImportError("No module named 'gro2000'")

        monkeypatch.setattr(XTCReader, "_load_offsets", lacking)
        with pytest.raises(MissingDependencyError, match=r"run\.xtc .*gro2000.*Install what is missing"):
            opened(MEMBRANE, whole("xtc"))

    def test_a_missing_package_that_is_no_import_error(self, whole):
        pytest.importorskip("MDAnalysis")
        try:
            import chemfiles  # noqa: F401
        except ImportError:
            with pytest.raises(MissingDependencyError, match="install Chemfiles"):
                opened(MEMBRANE, whole("dcd"), format="CHEMFILES")
        else:
            pytest.skip("chemfiles is installed")


class TestFormats:
    def test_an_unknown_extension_is_refused_with_the_option_that_helps(self, tmp_path):
        (tmp_path / "run.unheard").write_text("x")
        with pytest.raises(UnknownFormatError, match=r"'\.unheard' of .*run\.unheard.*option format\."):
            opened(MEMBRANE, tmp_path / "run.unheard")
        with pytest.raises(UnknownFormatError, match="option topology_format"):
            opened(tmp_path / "run.unheard")

    def test_an_unknown_format_is_refused(self, whole):
        with pytest.raises(UnknownFormatError, match="the format 'UNHEARD'"):
            opened(MEMBRANE, whole("dcd"), format="UNHEARD")

    def test_formats_can_be_named(self, whole, tmp_path):
        (tmp_path / "topology.out").write_bytes(MEMBRANE.read_bytes())
        (tmp_path / "run.out2").write_bytes(whole("dcd").read_bytes())
        reader = opened(tmp_path / "topology.out", tmp_path / "run.out2", topology_format="GRO", format="DCD")
        assert reader.n_frames == N_FRAMES

    def test_formats_of_parts_can_be_named(self, whole, tmp_path):
        (tmp_path / "run.out2").write_bytes(whole("dcd").read_bytes())
        assert opened(MEMBRANE, tmp_path / "run.out2", tmp_path / "run.out2", format="DCD").n_frames == 8

    def test_units_of_a_lammps_dcd(self, whole):
        nanometres = {"format": "LAMMPS", "lengthunit": "nm", "timeunit": "ps"}
        (in_nm, *_), (plain, *_) = (
            opened(MEMBRANE, whole("dcd"), cut="999", **options).frames() for options in (nanometres, {})
        )
        np.testing.assert_allclose(in_nm.positions, 10.0 * plain.positions, rtol=1e-6)

    def test_a_unit_that_is_none_is_refused(self, whole):
        with pytest.raises(InputError, match="unknown unit parsec"):
            opened(MEMBRANE, whole("dcd"), format="LAMMPS", lengthunit="parsec")

    def test_bonds_can_be_guessed(self):
        reader = opened(MEMBRANE, guess_bonds="yes")
        assert reader.strands.offsets.tolist() == [0, 6, 12]

    def test_continuous_parts_drop_the_frames_they_share(self, whole):
        assert opened(MEMBRANE, whole("xtc"), whole("xtc")).n_frames == 8
        assert opened(MEMBRANE, whole("xtc"), whole("xtc"), continuous="yes").n_frames == 4

    def test_an_unknown_option_is_refused(self):
        with pytest.raises(OptionError, match="Unknown option 'formt'"):
            opened(MEMBRANE, formt="GRO")

    @pytest.mark.parametrize(
        ("name", "known"),
        [
            ("a.PDB", True),
            ("a.xtc", True),
            ("b.gro.gz", True),
            ("c.npz", False),
            ("d", False),
            ("e.gz", False),
        ],
    )
    def test_what_can_be_opened_is_known_by_its_name(self, name, known):
        assert has_known_extension(Path(name)) is known
        assert MDAnalysisReader.can_open(Source(paths=(Path(name),))) is known

    def test_every_extension_is_one_of_mdanalysis(self):
        import MDAnalysis

        known = {name.lower() for name in (*MDAnalysis._READERS, *MDAnalysis._PARSERS)}
        assert EXTENSIONS - known == {"lammpstrj", "rst7"} & (EXTENSIONS - known)
