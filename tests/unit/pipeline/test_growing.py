import warnings
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import mdtopo
from mdtopo.errors import MissingFileError, TrajectoryError
from mdtopo.pipeline import open_input
from mdtopo.pipeline.growing import GrowingTrajectory
from mdtopo.records import Frame

DEMO = Path(mdtopo.__file__).parent / "demo"
N_FRAMES = 6


class Clock:
    """Time that passes only in sleep, and acts that happen in it: one each time the trajectory is waited for."""

    def __init__(self, *acts: Callable[[], object]) -> None:
        self.now, self.acts = 0.0, list(acts)

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        if self.acts:
            self.acts.pop(0)()

    def __call__(self) -> float:
        return self.now


def follow(paths: list[Path], clock: Clock, *, most: int = 64) -> tuple[list[Frame], str]:
    growing = GrowingTrajectory(
        lambda: open_input(*paths), paths, poll=1.0, idle_timeout=3.0, clock=clock, sleep=clock.sleep
    )
    return [frame for batch in growing.batches(most) for frame in batch], growing.failure


@pytest.fixture(params=["dcd", "xtc", "trr", "xyz"])
def written(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[list[Path], bytes]:
    """A topology, the place where a trajectory is to grow, and all of its bytes."""
    mda = pytest.importorskip("MDAnalysis")
    topology = tmp_path / "duplex.data"
    topology.write_bytes((DEMO / "duplex.data").read_bytes())
    whole = tmp_path / f"whole.{request.param}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        universe = mda.Universe(topology, DEMO / "pull.dcd")
        with mda.Writer(str(whole), universe.atoms.n_atoms) as writer:
            for _ in universe.trajectory[:N_FRAMES]:
                writer.write(universe.atoms)
    return [topology, tmp_path / f"run.{request.param}"], whole.read_bytes()


def appends(path: Path, content: bytes, cuts: list[int]) -> list[Callable[[], object]]:
    """Return acts that let the file grow up to each of the cuts."""

    def grow(start: int, stop: int) -> None:
        with path.open("ab") as file:
            file.write(content[start:stop])

    edges = [0, *cuts, len(content)]
    return [lambda a=a, b=b: grow(a, b) for a, b in pairwise(edges)]


@pytest.mark.parametrize("pieces", [3, 13])
@pytest.mark.parametrize("rests", [0, 1])
def test_every_frame_comes_once_and_whole_however_the_file_grows(
    written: tuple[list[Path], bytes], tmp_path: Path, pieces: int, rests: int
) -> None:
    """With rests, the file also stands still at each cut for a look, as if the writer had stopped within a frame."""
    paths, content = written
    cuts = np.linspace(0, len(content), pieces + 1, dtype=int)[1:-1].tolist()
    acts = [act for append in appends(paths[-1], content, cuts) for act in (append, *[lambda: None] * rests)]
    frames, failure = follow(paths, Clock(*acts))
    assert failure == ""
    assert [frame.index for frame in frames] == list(range(N_FRAMES))
    with open_input(paths[0], paths[-1]) as reader:
        for frame, true in zip(frames, reader.frames(), strict=True):
            np.testing.assert_array_equal(frame.positions, true.positions)
            assert frame.time == true.time or np.isnan([frame.time, true.time]).all()


def test_a_file_that_ends_within_a_frame_says_so(written: tuple[list[Path], bytes]) -> None:
    paths, content = written
    paths[-1].write_bytes(content[:-10])
    frames, failure = follow(paths, Clock())
    assert [frame.index for frame in frames] == list(range(N_FRAMES - 1))
    assert str(paths[-1]) in failure


def test_batches_are_no_longer_than_asked_for(written: tuple[list[Path], bytes]) -> None:
    paths, content = written
    paths[-1].write_bytes(content)
    clock = Clock()
    growing = GrowingTrajectory(
        lambda: open_input(*paths), paths, poll=1.0, idle_timeout=3.0, clock=clock, sleep=clock.sleep
    )
    # the last frame waits until the file has stood still for one look
    assert [len(batch) for batch in growing.batches(2)] == [2, 2, 1, 1]


def test_an_archive_that_is_written_anew_with_more_frames(tmp_path: Path) -> None:
    path, positions = tmp_path / "run.npz", np.random.default_rng(3).normal(size=(9, 8, 3))

    def write(n_frames: int) -> None:
        np.savez(path, positions=positions[:n_frames], offsets=np.array([0, 8]), closed=np.array([False]))

    def write_half() -> None:
        path.write_bytes(path.read_bytes()[:400])

    frames, failure = follow([path], Clock(lambda: write(2), lambda: write(5), write_half, lambda: write(9)))
    assert failure == ""
    np.testing.assert_array_equal(np.stack([frame.positions for frame in frames]), positions)


def test_a_trajectory_that_becomes_shorter_is_refused(tmp_path: Path) -> None:
    path, positions = tmp_path / "run.npz", np.zeros((9, 8, 3))

    def write(n_frames: int) -> None:
        np.savez(path, positions=positions[:n_frames], offsets=np.array([0, 8]), closed=np.array([False]))

    with pytest.raises(TrajectoryError, match="holds 3 frames and held 8 before"):
        follow([path], Clock(lambda: write(9), lambda: write(3)))


def test_a_missing_topology_is_refused_and_a_missing_trajectory_is_waited_for(tmp_path: Path) -> None:
    paths = [tmp_path / "duplex.data", tmp_path / "run.dcd"]
    with pytest.raises(MissingFileError, match=r"duplex\.data does not exist"):
        follow(paths, Clock())
    paths[0].write_bytes((DEMO / "duplex.data").read_bytes())
    clock = Clock()
    assert follow(paths, clock) == ([], f"{paths[1]} does not exist.")
    assert clock.now == pytest.approx(3.0)


def test_a_stop_ends_the_wait_at_once(tmp_path: Path) -> None:
    path, stopped = tmp_path / "run.npz", []
    clock = Clock(lambda: stopped.append(True))
    growing = GrowingTrajectory(
        lambda: open_input(path), [path], poll=1.0, is_stopped=lambda: bool(stopped), clock=clock, sleep=clock.sleep
    )
    assert list(growing.batches(8)) == []
    assert clock.now == pytest.approx(1.0)
