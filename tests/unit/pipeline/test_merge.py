"""Shards that are joined are the single run, bit for bit; what is no such thing is refused."""

from itertools import pairwise
from pathlib import Path

import kill_runs
import numpy as np
import pytest

import mdtopo
from mdtopo import MonitorConfig
from mdtopo.errors import InputError, OutputError
from mdtopo.pipeline import PartLength, StopRequest, merge


def shards_of(
    inputs: list[Path], folder: Path, cuts: list[int], *, in_a_row: bool = False, **how: object
) -> list[Path]:
    made: list[Path] = []
    for start, stop in pairwise(cuts):
        before = {"broken_from": made[-1]} if in_a_row and made else {}
        made.append(folder / f"shard{start}-{stop}.h5")
        mdtopo.monitor(*inputs, out=made[-1], frames=slice(start, stop + 1), **before, **how)  # type: ignore[arg-type]
    return made


def check_equal(out: Path, expected: Path) -> None:
    """Check every dataset and attribute, but for the command and the times in the provenance."""
    one, other = kill_runs.contents(out), kill_runs.contents(expected)
    for key in {*one, *other} - {"@provenance"}:
        assert one[key] == other[key], key


def check_same(inputs: list[Path], folder: Path, cuts: list[int], *, in_a_row: bool = False) -> None:
    whole, out = folder / "whole.h5", folder / "merged.h5"
    frames = slice(cuts[0], cuts[-1] + 1)
    first = mdtopo.monitor(*inputs, out=whole, alerts=folder / "whole.jsonl", frames=frames)
    made = shards_of(inputs, folder, cuts, in_a_row=in_a_row)
    second = merge(*reversed(made), out=out, alerts=folder / "merged.jsonl")
    assert second.to_mapping() == first.to_mapping()
    check_equal(out, whole)
    assert (folder / "merged.jsonl").read_bytes() == (folder / "whole.jsonl").read_bytes()


def test_shards_of_a_run_with_crossings_and_a_bad_frame(tmp_path: Path) -> None:
    check_same([kill_runs.write_input(tmp_path / "input.npz")], tmp_path, [0, 30, 31, 77, 95])


@pytest.mark.parametrize(
    ("names", "cuts"),
    [
        (("kg/kg_linear.data", "kg/kg_linear_fine_wrapped.xtc"), [0, 101, 190]),
        (("soft/soft.data", "soft/soft_fine.dcd"), [0, 50, 121]),
        (("fracture/duplex.data", "fracture/dup_pull.dcd"), [0, 150, 338]),
    ],
    ids=["kg", "soft", "pull"],
)
def test_shards_of_real_runs(tmp_path: Path, shared_data: Path, names: tuple[str, str], cuts: list[int]) -> None:
    check_same([shared_data / name for name in names], tmp_path, cuts)


def test_a_shard_that_did_not_know_of_a_break_is_refused_with_the_cure(tmp_path: Path) -> None:
    made = shards_of([kill_runs.write_input(tmp_path / "input.npz")], tmp_path, [0, 120, 239])
    with pytest.raises(InputError, match=r"At frame 120 the edge 3-4 .* again with --broken-from .*shard0-120\.h5\."):
        merge(*made, out=tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()


def write_breaking(path: Path) -> Path:
    """Write a chain, two bonds of which break, the first for good in frame 22, the other in frame 43."""
    frames = np.zeros((60, 12, 3)) + 1.5 * np.arange(12)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    frames += np.cumsum(np.random.default_rng(5).normal(0, 0.01, frames.shape), axis=0)
    frames[20:, 4:, 0] += 2.0
    frames[41:, 8:, 0] += 2.0
    np.savez(path, positions=frames, offsets=np.array([0, 12]), closed=np.array([False]), time=np.arange(60.0))
    return path


@pytest.mark.parametrize("cuts", [[0, 20, 59], [0, 22, 59], [0, 21, 30, 42, 59]])
def test_shards_that_begin_with_the_bonds_of_the_one_before_are_the_single_run(tmp_path: Path, cuts: list[int]) -> None:
    check_same([write_breaking(tmp_path / "input.npz")], tmp_path, cuts, in_a_row=True)


def test_only_the_shards_behind_a_break_are_measured_again(tmp_path: Path) -> None:
    """As one does it by hand: until merge has no objection, the shard that it names is measured again."""
    inputs, cuts = [write_breaking(tmp_path / "input.npz")], [0, 10, 21, 30, 59]
    made, again = shards_of(inputs, tmp_path, cuts), []
    while True:
        try:
            merge(*made, out=tmp_path / "merged.h5")
            break
        except InputError as error:
            pairs = enumerate(pairwise(made), 1)
            said = [
                k for k, (before, after) in pairs
                if f"which {after} did" in str(error) and str(error).endswith(f"--broken-from {before}.")
            ]  # fmt: skip
            again += said
            (k,) = said
            frames = slice(cuts[k], cuts[k + 1] + 1)
            mdtopo.monitor(*inputs, out=made[k], frames=frames, broken_from=made[k - 1], overwrite=True)
    assert again == [2, 3]
    mdtopo.monitor(*inputs, out=tmp_path / "whole.h5", frames=slice(0, 60))
    check_equal(tmp_path / "merged.h5", tmp_path / "whole.h5")


def test_a_shard_keeps_what_had_broken_before_it(tmp_path: Path) -> None:
    inputs = [write_breaking(tmp_path / "input.npz")]
    (first,) = shards_of(inputs, tmp_path, [0, 30])
    out = tmp_path / "second.h5"
    assert mdtopo.monitor(*inputs, out=out, frames=slice(30, 60), broken_from=first).n_fractures == 1
    found = mdtopo.read_results(out)
    assert [(edge.step, edge.frame, edge.edge) for edge in found.broken] == [(-1, 22, (3, 4)), (12, 43, (7, 8))]
    with pytest.raises(OutputError, match=r"second\.h5 exists already"):  # without the bonds it is another run
        mdtopo.monitor(*inputs, out=out, frames=slice(30, 60))


def test_a_stopped_shard_goes_on_with_the_bonds_that_it_began_with(tmp_path: Path) -> None:
    inputs, config = [write_breaking(tmp_path / "input.npz")], MonitorConfig(block_steps=4)
    (first,) = shards_of(inputs, tmp_path, [0, 22], config=config)
    out, count = tmp_path / "second.h5", 1
    how = {"frames": slice(22, 60), "config": config, "broken_from": first, "stop": StopRequest(0.0)}
    while mdtopo.monitor(*inputs, out=out, **how, parts=PartLength(steps=4)).checkpoint:  # type: ignore[arg-type]
        count += 1
    assert count > 4
    merge(first, out, out=tmp_path / "merged.h5")
    mdtopo.monitor(*inputs, out=tmp_path / "whole.h5", frames=slice(0, 60), config=config)
    check_equal(tmp_path / "merged.h5", tmp_path / "whole.h5")


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        (slice(31, 60), r"ends with frame 30, and this run begins with frame 31; .* give --frames 30:60,"),
        (slice(29, None), r"ends with frame 30, and this run begins with frame 29; .* give --frames 30:,"),
        (slice(30, 60, 2), r"has frames that are 1 apart, and this run has frames that are 2 apart"),
    ],
)
def test_a_shard_that_does_not_end_there_is_refused(tmp_path: Path, frames: slice, words: str) -> None:
    inputs = [write_breaking(tmp_path / "input.npz")]
    (first,) = shards_of(inputs, tmp_path, [0, 30])
    with pytest.raises(InputError, match=words):
        mdtopo.monitor(*inputs, out=tmp_path / "second.h5", frames=frames, broken_from=first)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["input.npz", "shard0-30.h5"]


def test_a_shard_of_another_run_is_refused(tmp_path: Path) -> None:
    inputs = [write_breaking(tmp_path / "input.npz")]
    (first,) = shards_of(inputs, tmp_path, [0, 30])
    with pytest.raises(InputError, match=r"is no shard of this run: the size of .*other\.npz was"):
        mdtopo.monitor(
            kill_runs.write_input(tmp_path / "other.npz"),
            out=tmp_path / "a.h5",
            frames=slice(30, 60),
            broken_from=first,
        )
    with pytest.raises(InputError, match=r"none\.h5 does not exist"):
        mdtopo.monitor(*inputs, frames=slice(30, 60), broken_from=tmp_path / "none.h5")


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ([(0, 40), (50, 90)], "The steps between the frames 40 and 50 are missing"),
        ([(0, 40), (30, 90)], "The steps between the frames 30 and 40 are doubled"),
        ([(0, 40), (0, 40)], "The steps between the frames 0 and 40 are doubled"),
    ],
)
def test_what_does_not_tile_is_refused(tmp_path: Path, ranges: list[tuple[int, int]], words: str) -> None:
    inputs = [kill_runs.write_input(tmp_path / "input.npz")]
    made = [shards_of(inputs, tmp_path, list(cut))[0] for cut in ranges]
    with pytest.raises(InputError, match=words):
        merge(*made, out=tmp_path / "run.h5")


def test_shards_of_two_trajectories_are_refused_by_the_names_of_the_files(tmp_path: Path) -> None:
    names = ("one.npz", "other.npz")
    x = np.arange(4.0)[:, np.newaxis] + np.zeros((3, 4, 3))
    for name, shift in zip(names, (0.0, 1.0), strict=True):
        np.savez(tmp_path / name, positions=x + shift, offsets=[0, 4], closed=[False])
    made = [tmp_path / "a.h5", tmp_path / "b.h5"]
    for name, out, frames in zip(names, made, (slice(0, 2), slice(1, 3)), strict=True):
        mdtopo.monitor(tmp_path / name, out=out, frames=frames)
    with pytest.raises(InputError, match=r"a\.h5 is of .*one\.npz, and .*b\.h5 of .*other\.npz, which is another file"):
        merge(*made, out=tmp_path / "run.h5")


def test_shards_of_other_runs_are_refused(tmp_path: Path) -> None:
    inputs = [kill_runs.write_input(tmp_path / "input.npz")]
    one = shards_of(inputs, tmp_path, [0, 40])
    other = shards_of(inputs, tmp_path, [40, 80], config=MonitorConfig(near_limit=0.7))
    with pytest.raises(InputError, match=r"is no shard of the run .*near_limit was 0\.8, and now is 0\.7"):
        merge(*one, *other, out=tmp_path / "run.h5")
    strands = mdtopo.Strands.from_lengths([4])
    x = np.arange(4.0)[:, np.newaxis] + np.zeros((3, 4, 3))
    mdtopo.monitor(x[:1], strands=strands, out=tmp_path / "empty.h5")
    with pytest.raises(InputError, match="holds no step"):
        merge(tmp_path / "empty.h5", out=tmp_path / "run.h5")
