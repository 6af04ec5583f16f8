from types import SimpleNamespace

import numpy as np
import pytest

from mdtopo.readers.mdanalysis.precision import coordinate_error

ROOT3 = 3.0**0.5
FLOAT32 = 2.0**-24


def stub(name, unit="Angstrom", **more):
    return SimpleNamespace(format=name, units={"length": unit}, **more)


@pytest.mark.parametrize(
    ("trajectory", "expected"),
    [
        (stub("DCD"), ROOT3 * 50 * FLOAT32),
        (stub("NCDF"), ROOT3 * 50 * FLOAT32),
        (stub(["NCDF", "NC"]), ROOT3 * 50 * FLOAT32),
        (stub("TRR", "nm"), ROOT3 * 3 * 50 * FLOAT32),
        (stub("GRO", "nm"), ROOT3 * (0.005 + 3 * 50 * FLOAT32)),
        (stub(["PDB", "ENT"]), ROOT3 * (0.0005 + 50 * FLOAT32)),
        (stub("SOMETHING"), ROOT3 * 50 * FLOAT32),
        (SimpleNamespace(format="MEMORY"), ROOT3 * 50 * FLOAT32),
    ],
)
def test_error_by_format(trajectory, expected):
    assert coordinate_error(trajectory, 50.0) == pytest.approx(expected, rel=1e-12)


@pytest.fixture
def write_xtc(tmp_path):
    from MDAnalysis.lib.formats.libmdaxdr import XTCFile

    def write(n_atoms, precision):
        path = tmp_path / "run.xtc"
        with XTCFile(str(path), "w") as file:
            positions = np.linspace(0, 5, 3 * n_atoms, dtype=np.float32).reshape(-1, 3)
            file.write(positions, np.eye(3, dtype=np.float32), 0, 0.0, precision)
        return path

    return write


@pytest.mark.parametrize(
    ("precision", "convert_units", "expected"),
    [(1000.0, True, 0.00866), (100.0, True, 0.0866), (10000.0, True, 0.000866), (1000.0, False, 0.000866)],
)
def test_error_of_an_xtc_by_the_precision_that_it_states(write_xtc, precision, convert_units, expected):
    from MDAnalysis.coordinates.XTC import XTCReader

    trajectory = XTCReader(str(write_xtc(20, precision)), convert_units=convert_units)
    assert coordinate_error(trajectory, 0.0) == pytest.approx(expected, rel=1e-3)


def test_no_stored_coordinate_is_further_off_than_said(write_xtc):
    from MDAnalysis.coordinates.XTC import XTCReader

    trajectory = XTCReader(str(write_xtc(20, 1000.0)))
    engine = 10.0 * np.linspace(0, 5, 60).reshape(-1, 3)
    off = np.linalg.norm(trajectory[0].positions.astype(np.float64) - engine, axis=1)
    assert 0.2 * coordinate_error(trajectory, 50.0) < off.max() <= coordinate_error(trajectory, 50.0)


def test_of_a_chain_of_files_the_coarsest_counts():
    chain = SimpleNamespace(readers=[stub("DCD"), stub("PDB"), stub("DCD")])
    assert coordinate_error(chain, 0.0) == pytest.approx(ROOT3 * 0.0005)


def test_a_scaled_dump_is_as_coarse_as_its_box():
    dump = stub("LAMMPSDUMP", ts=SimpleNamespace(dimensions=[200.0, 100.0, 100.0, 90.0, 90.0, 90.0]))
    assert coordinate_error(dump, 50.0) == pytest.approx(ROOT3 * 200.0 * 5e-6, rel=1e-2)
