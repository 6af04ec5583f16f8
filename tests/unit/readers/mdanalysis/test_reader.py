import logging
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mdtopo.errors import InputError, OptionError, SelectionError, StrandError, TrajectoryError
from mdtopo.readers import ReaderRequest, Source
from mdtopo.readers.mdanalysis import MDAnalysisReader
from mdtopo.records import Frame, Strands
from mdtopo.testing import Expectation, ReaderContract

FIXTURES = Path(__file__).parents[4] / "fixtures" / "strands"
MEMBRANE = FIXTURES / "membrane.gro"
CHAINS = "name CA"
CHAIN_ATOMS = np.arange(1, 36, 3)
"""The file indices of the twelve CA atoms in `membrane.gro`."""


def opened(*paths, select=None, **options):
    return MDAnalysisReader.open(Source(paths=tuple(map(Path, paths))), ReaderRequest(select, options))


def wandering(n_frames, n_atoms, seed=5):
    rng = np.random.default_rng(seed)
    return (20.0 + rng.normal(size=(n_frames, n_atoms, 3)).cumsum(axis=0)).astype(np.float32)


def write(path, positions, box=(40.0, 40.0, 30.0, 90.0, 90.0, 90.0)):
    """Write positions of all 45 atoms of the membrane to any format that MDAnalysis writes."""
    import MDAnalysis

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        universe = MDAnalysis.Universe(str(MEMBRANE))
        with MDAnalysis.Writer(str(path), n_atoms=positions.shape[1]) as file:
            for frame in positions:
                universe.atoms.positions = frame
                universe.dimensions = box
                file.write(universe.atoms)
    return path


def membrane_strands():
    return Strands.from_lengths([6, 6])


class TestFiles(ReaderContract):
    reader_class = MDAnalysisReader

    @pytest.fixture
    def source(self, tmp_path):
        return Source(paths=(MEMBRANE, write(tmp_path / "run.dcd", wandering(5, 45))))

    @pytest.fixture
    def request_(self):
        return ReaderRequest(select=CHAINS, options={"dt": "2.0"})

    @pytest.fixture
    def expected(self):
        positions = wandering(5, 45)[:, CHAIN_ATOMS].astype(np.float64)
        cell = np.diag([40.0, 40.0, 30.0])
        frames = tuple(Frame(k, 2.0 * k, x, cell) for k, x in enumerate(positions))
        return Expectation(frames, membrane_strands())


class TestUniverse(ReaderContract):
    reader_class = MDAnalysisReader

    @pytest.fixture
    def source(self):
        import MDAnalysis

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            universe = MDAnalysis.Universe(str(MEMBRANE))
            return Source(object=universe.load_new(wandering(4, 45), order="fac", dt=0.5))

    @pytest.fixture
    def request_(self):
        return ReaderRequest(select=CHAINS)

    @pytest.fixture
    def expected(self):
        positions = wandering(4, 45)[:, CHAIN_ATOMS].astype(np.float64)
        return Expectation(tuple(Frame(k, 0.5 * k, x) for k, x in enumerate(positions)), membrane_strands())

    def test_the_frame_of_the_universe_is_put_back(self, source, request_):
        source.object.trajectory[2]
        with MDAnalysisReader.open(source, request_) as reader:
            assert source.object.trajectory.frame == 2
            assert len(list(reader.frames())) == 4
        assert source.object.trajectory.frame == 2

    def test_the_trajectory_of_the_universe_stays_open(self, source, request_):
        MDAnalysisReader.open(source, request_).close()
        assert source.object.trajectory[3].frame == 3


class TestRing(ReaderContract):
    reader_class = MDAnalysisReader

    @pytest.fixture
    def source(self):
        return Source(paths=(FIXTURES / "ring_out_of_order.data",))

    @pytest.fixture
    def request_(self):
        return ReaderRequest()

    @pytest.fixture
    def expected(self):
        angle = 2 * np.pi * np.arange(8) / 8
        ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        stored = np.round(1.3 * ring, 5).astype(np.float32).astype(np.float64) + 0.0
        return Expectation((Frame(0, np.nan, stored, np.diag([20.0] * 3)),), Strands.from_lengths([8], closed=True))


class TestAtomGroup:
    @pytest.fixture
    def universe(self):
        import MDAnalysis

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return MDAnalysis.Universe(str(MEMBRANE))

    def opened(self, thing, select=None, **options):
        return MDAnalysisReader.open(Source(object=thing), ReaderRequest(select, options))

    def test_a_group_is_the_selection(self, universe):
        reader = self.opened(universe.select_atoms("name N CA C and resid 7:9"))
        assert reader.strands.labels.atom.tolist() == ["N", "CA", "C"] * 6

    def test_a_selection_is_made_within_a_group(self, universe):
        reader = self.opened(universe.select_atoms("resid 7:9"), CHAINS)
        assert reader.strands.labels.resid.tolist() == [7, 8, 9] * 2

    def test_all_atoms_are_no_selection(self, universe):
        assert self.opened(universe.atoms).strands.labels.atom.tolist() == ["CA"] * 12

    def test_a_group_is_read_in_file_order_and_without_doubles(self, universe):
        group = universe.select_atoms("name CA and resid 7:9")
        reader = self.opened(group[::-1] + group)
        assert reader.strands.labels.atom_index.tolist() == [1, 4, 7, 19, 22, 25]

    def test_a_group_that_updates_itself_is_frozen_with_a_note(self, universe):
        reader = self.opened(universe.select_atoms("name CA and prop x < 16", updating=True))
        assert reader.strands.n_vertices == 8
        assert "updates itself" in reader.notes[0]

    def test_options_of_opening_are_refused(self, universe):
        with pytest.raises(OptionError, match="the input is open already"):
            self.opened(universe, dt="1")
        assert self.opened(universe, cut="6").strands.n_strands == 2

    def test_a_universe_without_coordinates_is_refused(self):
        import MDAnalysis

        with pytest.raises(InputError, match="a MDAnalysis Universe has no coordinates"):
            self.opened(MDAnalysis.Universe.empty(4))

    def test_a_universe_without_any_attributes_is_one_row_of_beads(self):
        import MDAnalysis

        universe = MDAnalysis.Universe.empty(5, trajectory=True)
        universe.atoms.positions = np.arange(15, dtype=np.float32).reshape(5, 3)
        assert self.opened(universe).strands.offsets.tolist() == [0, 5]


class TestSelection:
    def test_the_default_trace_is_named_in_the_notes(self):
        assert "The trace is the default one: protein and name CA." in opened(MEMBRANE).notes

    @pytest.mark.parametrize(
        ("select", "words"),
        [
            ("nme CA", "'nme CA' is malformed.*nme"),
            ("name CA and", "malformed"),
            ("chainID A", "asks for what the topology does not hold"),
            ("name XX", "matches none of the 45 atoms, which are called"),
            ("", "matches none of the 45 atoms"),
        ],
    )
    def test_a_selection_that_fails_is_quoted(self, select, words):
        with pytest.raises(SelectionError, match=words):
            opened(MEMBRANE, select=select)

    def test_lipids_alone_are_refused(self):
        with pytest.raises(StrandError, match=r"No two of the 3 selected atoms are joined \(3 P of POPE\)"):
            opened(MEMBRANE, select="name P")

    def test_lipids_beside_chains_are_left_out(self):
        reader = opened(MEMBRANE, select="name CA P")
        assert reader.strands.offsets.tolist() == [0, 6, 12]
        assert "Left out 3 atoms joined to no other selected one: 3 P of POPE." in reader.notes

    def test_two_chains_of_one_segment_are_two_strands(self):
        reader = opened(MEMBRANE, select=CHAINS)
        assert reader.strands.names == ("strand 0", "strand 1")
        assert reader.strands.labels.text(6) == "1:ALA7"

    def test_calcium_alternate_locations_and_insertion_codes(self):
        reader = opened(FIXTURES / "traps.pdb", select=CHAINS)
        assert [reader.strands.labels.text(v) for v in range(4)] == [
            "A:ALA27",
            "A:GLY27A",
            "A:SER28",
            "A:ALA29",
        ]
        (frame,) = reader.frames()
        np.testing.assert_allclose(frame.positions[2], [7.6, -0.3, 0.0], atol=1e-6)
        assert "Left out 1 ion or water bead: 1 CA of CA." in reader.notes

    def test_calcium_alone_is_refused(self):
        with pytest.raises(StrandError, match="nothing but ions"):
            opened(FIXTURES / "traps.pdb", select="name CA and resid 301")

    def test_a_single_vertex_is_refused(self):
        with pytest.raises(StrandError, match=r"a single vertex, CA of A:SER28 \(atom 8\)"):
            opened(FIXTURES / "traps.pdb", select="resid 28 and name CA")

    def test_a_star_is_refused_and_its_bonds_may_be_ignored(self):
        with pytest.raises(StrandError, match="branch at bead 1"):
            opened(FIXTURES / "star.data")
        assert opened(FIXTURES / "star.data", use_bonds="no").strands.offsets.tolist() == [0, 7]

    def test_strands_of_the_caller_are_refused(self):
        request = replace(ReaderRequest(), strands=Strands.from_lengths([12]))
        with pytest.raises(InputError, match="tells its strands itself"):
            MDAnalysisReader.open(Source(paths=(MEMBRANE,)), request)


class TestTimesAndCells:
    def test_a_file_without_times_has_none(self, tmp_path):
        reader = opened(MEMBRANE, write(tmp_path / "run.xyz", wandering(2, 45)))
        assert [frame.time for frame in reader.frames()] == pytest.approx([np.nan] * 2, nan_ok=True)
        assert (
            "The trajectory holds no times; pass --reader-option dt=..., the time between frames in ps." in reader.notes
        )

    def test_dt_gives_it_times(self, tmp_path):
        reader = opened(MEMBRANE, write(tmp_path / "run.xyz", wandering(2, 45)), dt="5", time_offset="100")
        assert [frame.time for frame in reader.frames()] == [100.0, 105.0]

    def test_a_box_of_zeros_is_none(self, tmp_path):
        path = write(tmp_path / "run.dcd", wandering(2, 45), box=np.zeros(6))
        reader = opened(MEMBRANE, path)
        assert [frame.cell for frame in reader.frames()] == [None, None]
        assert "There is no periodic box in the first frame." in reader.notes

    def test_a_box_that_is_no_number_is_bad_data_and_not_no_box(self):
        from mdtopo.readers.mdanalysis.cells import cell_of

        for box in (
            [np.nan] * 6,
            [10, np.inf, 10, 90, 90, 90],
            [10, 10, 0, 90, 90, 90],
            [9, 9, 9, 130, 130, 130],
        ):
            cell = cell_of(np.array(box, dtype=np.float32))
            assert cell.shape == (3, 3)
            assert np.isnan(cell).all()

    def test_lattice_vectors_are_computed_in_double_precision(self, tmp_path):
        box = (70.0, 70.0, 70.0, 60.0, 60.0, 90.0)
        reader = opened(MEMBRANE, write(tmp_path / "run.dcd", wandering(1, 45), box=box))
        (frame,) = reader.frames()
        expected = [[70.0, 0.0, 0.0], [0.0, 70.0, 0.0], [35.0, 35.0, 70.0 / 2**0.5]]
        np.testing.assert_allclose(frame.cell, expected, atol=1e-12)

    def test_units_may_be_left_alone(self, tmp_path):
        path = write(tmp_path / "run.xtc", wandering(1, 45))
        (angstrom,), (nm,) = (
            opened(MEMBRANE, path).frames(),
            opened(MEMBRANE, path, convert_units="no").frames(),
        )
        np.testing.assert_allclose(angstrom.positions, 10.0 * nm.positions, rtol=1e-6)
        np.testing.assert_allclose(angstrom.cell, 10.0 * nm.cell, rtol=1e-6)

    def test_parts_are_read_one_after_the_other(self, tmp_path):
        parts = [write(tmp_path / f"{k}.{kind}", wandering(3, 45, k)) for k, kind in enumerate(["dcd", "trr"])]
        reader = opened(MEMBRANE, *parts)
        found = np.stack([frame.positions for frame in reader.frames()])
        expected = np.concatenate([wandering(3, 45, k)[:, CHAIN_ATOMS] for k in range(2)])
        assert reader.n_frames == 6
        assert [frame.index for frame in reader.frames()] == [*range(6)]
        np.testing.assert_allclose(found, expected, atol=1e-4)

    def test_a_closed_reader_reads_no_more(self):
        reader = opened(MEMBRANE)
        reader.close()
        with pytest.raises(TrajectoryError, match="is closed; open it again"):
            list(reader.frames())


SYSTEMS = [
    ("kg/kg_linear.data", "kg/kg_linear_fine.dcd", [100] * 20, False, 501),
    ("kg/kg_linear.data", "kg/kg_linear_fine_wrapped.xtc", [100] * 20, False, 501),
    ("kg/kg_rings.data", "kg/kg_rings_fine.dcd", [100] * 20, True, 501),
    ("rings/hopf.data", "rings/pair_hopf_fine.dcd", [64, 64], True, 5001),
    ("fracture/duplex.data", "fracture/dup_pull.dcd", [60, 60], False, 439),
    ("soft/soft.data", "soft/soft_fine.dcd", [100] * 20, False, 501),
    ("gmx/ca.gro", "gmx/ca_raw.xtc", [58], False, 501),
    ("gmx/md.tpr", "gmx/md.xtc", [58], False, 501),
    ("gmx/bpti.pdb", None, [58], False, 1),
]


class TestRealEngines:
    @pytest.mark.parametrize(("topology", "trajectory", "lengths", "closed", "n_frames"), SYSTEMS)
    def test_strands_are_those_of_the_model(self, shared_data, topology, trajectory, lengths, closed, n_frames, caplog):
        paths = [shared_data / name for name in (topology, trajectory) if name]
        with caplog.at_level(logging.WARNING, "mdtopo"), opened(*paths) as reader:
            strands = reader.strands
            assert np.diff(strands.offsets).tolist() == lengths
            assert set(strands.closed.tolist()) == {closed}
            assert strands.gaps == ()
            assert reader.n_frames == n_frames
            if topology.endswith("data"):
                assert strands.labels.atom_index.tolist() == [*range(sum(lengths))]
            *_, last = reader.frames(n_frames - 2 if n_frames > 1 else 0)
            assert last.index == n_frames - 1
            assert not last.problem
        assert [record.message for record in caplog.records] == []

    def test_rungs_of_the_duplex_are_counted(self, shared_data):
        with opened(shared_data / "fracture" / "duplex.data") as reader:
            assert any("there are 178 bonds" in note for note in reader.notes)

    def test_a_backbone_of_three_atoms_passes_the_disulfides_by(self, shared_data):
        with opened(shared_data / "gmx" / "md.tpr", shared_data / "gmx" / "md.xtc", select="name N CA C") as reader:
            assert reader.strands.offsets.tolist() == [0, 174]
            assert reader.strands.gaps == ()

    def test_bonds_of_disulfides_alone_leave_the_chain_whole(self, shared_data):
        # the PDB file lists three CONECT records, those of the disulfides
        with opened(shared_data / "gmx" / "bpti.pdb", select="name CA SG") as reader:
            assert reader.strands.labels.atom.tolist().count("CA") == 58

    def test_units_of_a_lammps_model_are_noted(self, shared_data):
        folder = shared_data / "kg"
        dcd = opened(folder / "kg_linear.data", folder / "kg_linear_fine.dcd")
        xtc = opened(folder / "kg_linear.data", folder / "kg_linear_fine_wrapped.xtc")
        assert any("times mean nothing" in note for note in dcd.notes)
        assert any("ten times" in note for note in xtc.notes)
        assert not any("times mean" in note for note in opened(folder / "kg_linear.data").notes)


class TestFilesOfMDAnalysis:
    @pytest.mark.parametrize(
        ("topology", "trajectory", "lengths", "n_frames", "has_cell"),
        [
            ("PSF", "DCD", [214], 98, False),
            ("GRO", "XTC", [214], 10, True),
            ("GRO", "TRR", [214], 10, True),
            ("GRO_MEMPROT", "XTC_MEMPROT", [282, 282], 5, True),
            ("PDB_full", None, [99, 99, 6], 1, True),
        ],
    )
    def test_strands_and_frames(self, topology, trajectory, lengths, n_frames, has_cell):
        datafiles = pytest.importorskip("MDAnalysisTests.datafiles")
        paths = [getattr(datafiles, name) for name in (topology, trajectory) if name]
        with opened(*paths) as reader:
            assert np.diff(reader.strands.offsets).tolist() == lengths
            frames = list(reader.frames())
        assert len(frames) == n_frames
        assert {frame.cell is not None for frame in frames} == {has_cell}

    def test_frames_are_what_mdanalysis_reads(self):
        datafiles = pytest.importorskip("MDAnalysisTests.datafiles")
        import MDAnalysis

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            universe = MDAnalysis.Universe(datafiles.GRO, datafiles.XTC)
            atoms = universe.select_atoms("name CA")
            expected = [atoms.positions.copy() for _ in universe.trajectory]
        with opened(datafiles.GRO, datafiles.XTC, select="name CA") as reader:
            for frame, positions in zip(reader.frames(), expected, strict=True):
                assert np.array_equal(frame.positions, positions)

    def test_a_dcd_that_declares_more_frames_than_it_holds_says_so(self):
        datafiles = pytest.importorskip("MDAnalysisTests.datafiles")
        with opened(datafiles.PSF, datafiles.DCD) as reader:
            assert any("declares 500 frames, but the file holds 98" in note for note in reader.notes)

    def test_lipids_of_a_real_membrane_are_refused(self):
        datafiles = pytest.importorskip("MDAnalysisTests.datafiles")
        with pytest.raises(StrandError, match=r"No two of the 276 selected atoms"):
            opened(datafiles.GRO_MEMPROT, datafiles.XTC_MEMPROT, select="name P")

    def test_rna_is_traced_by_its_c4(self):
        datafiles = pytest.importorskip("MDAnalysisTests.datafiles")
        with opened(datafiles.RNA_PSF, datafiles.RNA_PDB) as reader:
            assert set(reader.strands.labels.atom.tolist()) == {"C4'"}
            assert reader.strands.offsets.tolist() == [0, 23]


@pytest.mark.parametrize("select", ["name CA and type C", "name CA and mass 10 to 14", "prop mass > 11.9 and name CA"])
def test_a_selection_may_ask_for_what_mdanalysis_guesses(select: str) -> None:
    from MDAnalysisTests import datafiles

    source = Source(paths=(Path(datafiles.GRO), Path(datafiles.XTC)))
    with MDAnalysisReader.open(source, ReaderRequest(select=select)) as reader:
        assert reader.strands.n_vertices == 214
