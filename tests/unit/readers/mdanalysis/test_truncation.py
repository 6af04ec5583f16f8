import struct

import numpy as np
import pytest

from mdtopo.readers.mdanalysis.truncation import dcd_size, spare_xdr_bytes, spare_xyz_lines


def dcd_bytes(n_frames, n_atoms=5, *, order="<", declared=None, has_cell=True, n_fixed=0):
    """Return a CHARMM DCD file, written here from the format's description."""

    def record(content):
        marker = struct.pack(order + "i", len(content))
        return marker + content + marker

    numbers = [
        n_frames if declared is None else declared,
        0,
        1,
        *[0] * 5,
        n_fixed,
        0,
        int(has_cell),
        *[0] * 8,
        24,
    ]
    head = record(b"CORD" + struct.pack(order + "20i", *numbers))
    head += record(struct.pack(order + "i", 1) + b"made by a test".ljust(80))
    head += record(struct.pack(order + "i", n_atoms))
    axis = record(np.zeros(n_atoms, dtype=order + "f4").tobytes())
    cell = record(np.zeros(6, dtype=order + "f8").tobytes()) if has_cell else b""
    return head, cell + 3 * axis


@pytest.fixture
def dcd(tmp_path):
    def write(n_frames, spare=0, **header):
        head, frame = dcd_bytes(n_frames, **header)
        path = tmp_path / "run.dcd"
        path.write_bytes(head + n_frames * frame + frame[:spare])
        return path

    return write


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("has_cell", [True, False])
@pytest.mark.parametrize("spare", [0, 1, 60])
def test_bytes_after_the_last_whole_frame_are_counted(dcd, order, has_cell, spare):
    size = dcd_size(dcd(3, spare, order=order, has_cell=has_cell))
    assert (size.declared, size.spare_bytes) == (3, spare)


def test_the_header_may_declare_more_than_there_is(dcd):
    assert dcd_size(dcd(3, declared=500)).declared == 500


def test_mdanalysis_reads_what_these_tests_write(dcd):
    from MDAnalysis.lib.formats.libdcd import DCDFile

    with DCDFile(str(dcd(3))) as file:
        assert (len(file), file.header["natoms"]) == (3, 5)


def test_fixed_atoms_make_frames_of_two_sizes_and_are_not_judged(dcd):
    assert dcd_size(dcd(3, n_fixed=2)) is None


@pytest.mark.parametrize("content", [b"", b"CORD", b"hello world" * 20, struct.pack("<i", 84) + b"VELD" + bytes(99)])
def test_what_is_no_dcd_is_not_judged(tmp_path, content):
    path = tmp_path / "other"
    path.write_bytes(content)
    assert dcd_size(path) is None


@pytest.mark.parametrize(
    ("end", "spare"),
    [("", 0), ("\n", 0), ("\n\n \n", 0), ("\n3", 1), ("\n3\ncomment\nC 0 0", 3), ("\n3\n", 1)],
)
def test_lines_after_the_last_whole_frame_of_an_xyz_are_counted(tmp_path, end, spare, monkeypatch):
    path = tmp_path / "run.xyz"
    frame = "3\ncomment\n" + "\n".join(["C 0 0 0"] * 3)
    path.write_text(frame + "\n" + frame + end)
    for block in (1, 7, 1 << 20):
        monkeypatch.setattr("mdtopo.readers.mdanalysis.truncation.BLOCK", block)
        assert spare_xyz_lines(path, 3) == spare


def write_xdr(path, n_atoms, n_frames=3, *, velocities=False):
    import MDAnalysis

    universe = MDAnalysis.Universe.empty(n_atoms, trajectory=True, velocities=velocities)
    random = np.random.default_rng(n_atoms)
    with MDAnalysis.Writer(str(path), n_atoms=n_atoms) as file:
        for _ in range(n_frames):
            universe.atoms.positions = random.normal(size=(n_atoms, 3))
            universe.dimensions = [40.0, 40.0, 30.0, 90.0, 90.0, 90.0]
            file.write(universe.atoms)
    return path


@pytest.mark.parametrize("n_atoms", [1, 9, 10, 47])
@pytest.mark.parametrize("kind", ["xtc", "trr", "velocities.trr"])
@pytest.mark.parametrize("spare", [0, 1, 50])
def test_bytes_after_the_last_frame_of_an_xtc_or_trr_are_counted(tmp_path, kind, n_atoms, spare):
    """XTC packs the coordinates of ten atoms or more."""
    from MDAnalysis.lib.formats.libmdaxdr import TRRFile, XTCFile

    path = write_xdr(tmp_path / f"run.{kind}", n_atoms, velocities="velocities" in kind)
    with (XTCFile if kind == "xtc" else TRRFile)(str(path)) as file:
        starts = file.offsets.tolist()
    with path.open("ab") as file:
        file.write(path.read_bytes()[:spare])
    assert spare_xdr_bytes(path, starts[-1]) == spare
    assert spare_xdr_bytes(path, starts[1]) == spare + path.stat().st_size - spare - starts[2]


def test_a_large_xtc_has_sizes_of_eight_bytes(tmp_path):
    head = struct.pack(">3i10f", 2023, 20, 0, *[0.0] * 10) + struct.pack(">if7i", 20, 1000.0, *[0] * 7)
    path = tmp_path / "large.xtc"
    path.write_bytes(head + struct.pack(">q", 21) + bytes(24) + b"spare")
    assert spare_xdr_bytes(path, 0) == 5


@pytest.mark.parametrize("content", [b"", b"\0\0", b"hello world" * 20, struct.pack(">i", 1995) + bytes(20)])
def test_what_is_no_frame_of_xtc_or_trr_is_not_judged(tmp_path, content):
    path = tmp_path / "other"
    path.write_bytes(content)
    assert spare_xdr_bytes(path, 0) == 0
