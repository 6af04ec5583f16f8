"""Shards that are joined are the single run, bit for bit; what is no such thing is refused."""

from itertools import pairwise
from pathlib import Path

import kill_runs
import numpy as np
import pytest

import mdtopo
from mdtopo import MonitorConfig
from mdtopo.errors import InputError
from mdtopo.pipeline import merge


def shards_of(inputs: list[Path], folder: Path, cuts: list[int], **how: object) -> list[Path]:
    made = []
    for start, stop in pairwise(cuts):
        made.append(folder / f"shard{start}-{stop}.h5")
        mdtopo.monitor(*inputs, out=made[-1], frames=slice(start, stop + 1), **how)  # type: ignore[arg-type]
    return made


def check_same(inputs: list[Path], folder: Path, cuts: list[int]) -> None:
    whole, out = folder / "whole.h5", folder / "merged.h5"
    frames = slice(cuts[0], cuts[-1] + 1)
    first = mdtopo.monitor(*inputs, out=whole, alerts=folder / "whole.jsonl", frames=frames)
    made = shards_of(inputs, folder, cuts)
    second = merge(*reversed(made), out=out, alerts=folder / "merged.jsonl")
    assert second.to_mapping() == first.to_mapping()
    found, expected = kill_runs.contents(out), kill_runs.contents(whole)
    for key in {*found, *expected} - {"@provenance"}:
        assert found[key] == expected[key], key
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
    with pytest.raises(InputError, match=r"At frame 120 the edge 3-4 .* Put one shard --frames 0:240: in the place"):
        merge(*made, out=tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()


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
