"""Results against the referee: what agrees, what is found when a file was tampered with, and which steps are taken."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from mdtopo import MonitorConfig, monitor
from mdtopo.errors import InputError
from mdtopo.records import CurveVerdict, Frame, Reason, Strands, Verdict
from mdtopo.reopening import input_files
from mdtopo.store import Results, read_results
from mdtopo.verification import Sampling, StepCheck, check_step, chosen_steps, file_differences, verify

EVERY = Sampling(nearest=1000)
CROSSED = 4
"""The step in which the second bar passes through the first one, if it does."""


def bars(passes: bool) -> np.ndarray:
    """Two bars of three vertices, the second above the first; it moves slowly down, and through it in one step."""
    low = np.array([[-1.5, 0, 0], [-0.5, 0, 0], [0.5, 0, 0], [1.5, 0, 0]])
    high = np.array([[0.1, -1.5, 0], [0.1, -0.5, 0], [0.1, 0.5, 0], [0.1, 1.5, 0]])
    heights = 2.0 - 0.45 * np.arange(9) if passes else 2.0 - 0.1 * np.arange(9)
    frames = [np.concatenate([low, high + [0, 0, z]]) for z in heights]  # noqa: RUF005
    return np.array(frames) + np.random.default_rng(3).normal(0, 0.003, (9, 8, 3))


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., Path]:
    def make(positions: np.ndarray, *, motion: str = "lab", profile_steps: int = 0, **arrays: Any) -> Path:
        source = tmp_path / "run.npz"
        offsets, closed = np.array([0, 4, 8]), np.array([False, False])
        np.savez(source, positions=positions, offsets=offsets, closed=closed, time=np.arange(9.0), **arrays)
        out = tmp_path / "run.h5"
        config = MonitorConfig(motion=motion, profile_steps=profile_steps)  # type: ignore[arg-type]
        monitor(source, out=out, config=config, overwrite=True)
        return out

    return make


def tamper(path: Path, column: str, row: int, value: Any) -> None:
    with h5py.File(path, "a") as file:
        file[f"steps/{column}"][row] = value


def store_crossing(path: Path, **values: Any) -> None:
    """Write one crossing of step CROSSED into the file, in place of those it has, whatever the job found."""
    row: dict[str, Any] = {"step": CROSSED, "frame_t0": CROSSED, "frame_t1": CROSSED + 1, **values}
    with h5py.File(path, "a") as file:
        for name, dataset in file["crossings"].items():
            dataset.resize(1, axis=0)
            dataset[0] = row.get(name, 0)
        steps = file["steps"]
        steps["n_crossings"][...] = steps["curve_n_crossings"][...] = 0
        steps["curve_verdict"][...] = CurveVerdict.NONE
        steps["n_crossings"][CROSSED] = 1
        steps["verdict"][CROSSED] = Verdict.CROSSING
        steps["reason"][CROSSED] = Reason.NONE
        steps["clearance"][CROSSED] = 0.0
        counts = steps["verdict"][()].view(np.int8)
        file.attrs["summary"] = (
            f'{{"counts": {{"ball": {int((counts == Verdict.CERTIFIED).sum())}, "pairs": 0, "near_limit": 0, '
            f'"unresolved": {int((counts == Verdict.UNRESOLVED).sum())}, "crossed": 1}}}}'
        )


def true_crossing(positions: np.ndarray) -> dict[str, Any]:
    """The crossing of step CROSSED, by bisection of the volume of its two middle edges."""
    x0, x1 = positions[CROSSED], positions[CROSSED + 1]

    def volume(t: float) -> float:
        a, b, c, d = (x0 + t * (x1 - x0))[[1, 2, 5, 6]]
        return float(np.linalg.det([a - c, b - a, d - c]))

    low, high = 0.0, 1.0
    rises = volume(1.0) > 0.0
    assert (volume(0.0) > 0.0) is not rises
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if (volume(middle) > 0.0) is rises else (middle, high)
    a, b, c, d = (x0 + low * (x1 - x0))[[1, 2, 5, 6]]
    s, r = np.linalg.lstsq(np.stack([b - a, c - d], axis=1), c - a, rcond=None)[0]
    return {"t": low, "edges": [[1, 2], [5, 6]], "parameters": [s, r], "sign": 1 if rises else -1, "image": [0, 0, 0]}


def only(path: Path, *, step: int | None = None) -> list[str]:
    """Return the sentences of what differs, each with its step where one is asked for."""
    found = verify(path, sampling=EVERY)
    assert not found.agrees
    wrong = [check for check in found.checks if check.differences]
    if step is not None:
        assert [check.step for check in wrong] == [step]
    return [text for check in wrong for text in check.differences]


# --- agreement --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", ["lab", "rigid"])
@pytest.mark.parametrize("passes", [False, True])
@pytest.mark.parametrize("cell", [None, 12.0 * np.eye(3)], ids=["free", "periodic"])
def test_what_the_job_writes_agrees(run: Callable[..., Path], passes: bool, motion: str, cell: Any) -> None:
    arrays = {} if cell is None else {"cell": cell}
    found = verify(run(bars(passes), motion=motion, profile_steps=1, **arrays), sampling=EVERY)
    assert found.agrees, found
    assert found.n_steps == len(found.checks) == 8
    assert found.notes == ()


def test_a_profile_that_claims_too_much_or_is_of_another_step_is_found(run: Callable[..., Path]) -> None:
    path = run(bars(True), profile_steps=32)
    found = read_results(path)
    assert found.profile is not None
    assert found.profile.step.tolist() == [CROSSED]
    v = int(np.argmax(found.profile.clearance[0]))
    with h5py.File(path, "a") as file:
        file["profile/clearance"][0, v] += 0.5
    (text,) = only(path, step=CROSSED)
    assert text.startswith(f"the profile has {found.profile.clearance[0, v] + 0.5:.9g} Å at ")
    with h5py.File(path, "a") as file:
        file["profile/clearance"][0] = found.profile.clearance[0]
        file["profile/clearance"][0, np.argmin(found.profile.clearance[0])] = np.nan
    (text,) = only(path, step=CROSSED)
    assert "has no pair, but its edges come within" in text
    with h5py.File(path, "a") as file:
        file["profile/clearance"][0] = found.profile.clearance[0]
        file["profile/step"][0] = CROSSED + 1
    assert any(f"the closest step in it is {CROSSED} with 0 Å" in text for text in verify(path).differences)
    with h5py.File(path, "a") as file:
        file["profile/step"][0] = CROSSED
        file["profile/window"][0] = 7
    assert any("the profile has 1 windows" in text for text in verify(path).differences)


def test_an_unresolved_step_is_told_what_the_referee_finds(run: Callable[..., Path]) -> None:
    path = run(bars(True))
    tamper(path, "verdict", CROSSED, Verdict.UNRESOLVED)
    tamper(path, "n_crossings", CROSSED, 0)
    tamper(path, "curve_n_crossings", CROSSED, 0)
    tamper(path, "curve_verdict", CROSSED, CurveVerdict.NONE)
    with h5py.File(path, "a") as file:
        for dataset in file["crossings"].values():
            dataset.resize(0, axis=0)
        file.attrs["summary"] = "{}"
    found = verify(path, sampling=EVERY)
    assert found.agrees
    (check,) = (check for check in found.checks if check.step == CROSSED)
    assert (check.kind, check.note) == ("unresolved", "the referee finds 1 crossing")


def test_a_stored_crossing_that_is_true_agrees(run: Callable[..., Path]) -> None:
    positions = bars(True)
    path = run(positions)
    store_crossing(path, **true_crossing(positions))
    found = verify(path, sampling=EVERY)
    assert found.agrees, found
    assert next(check for check in found.checks if check.step == CROSSED).kind == "crossing"


def test_bad_frames_must_be_unresolved(run: Callable[..., Path]) -> None:
    positions = bars(False)
    positions[5, 2, 1] = np.nan
    path = run(positions)
    found = verify(path, sampling=EVERY)
    assert found.agrees
    notes = {check.step: check.note for check in found.checks if check.note}
    assert set(notes) == {4, 5}
    assert "frame 5 has coordinates that are no numbers" in notes[4]
    tamper(path, "verdict", 4, Verdict.CERTIFIED)
    (sentence,) = only(path, step=4)
    assert sentence.startswith("it is CERTIFIED, but frame 5 has coordinates")


def test_broken_edges_are_left_out_from_the_frame_on_that_showed_it(tmp_path: Path) -> None:
    n = 14
    x = np.zeros((n, 6, 3))
    x[:, :, 0] = np.arange(6.0)
    x[8:, 3:, 0] += 3.0
    x += np.random.default_rng(0).normal(0, 0.002, x.shape)
    np.savez(tmp_path / "a.npz", positions=x, offsets=[0, 6], closed=[False])
    monitor(tmp_path / "a.npz", out=tmp_path / "a.h5")
    results = read_results(tmp_path / "a.h5")
    assert [edge.edge for edge in results.broken] == [(2, 3)]
    assert verify(tmp_path / "a.h5", sampling=EVERY).agrees
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["strands/broken_frame"][0] += 2
    assert any("nu is" in text or "displacement" in text or "clearance" in text for text in only(tmp_path / "a.h5"))


# --- what was tampered with -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("column", "factor", "words"),
    [
        ("nu", 1 + 1e-6, "nu is "),
        ("displacement_max", 1 + 1e-6, "displacement_max is "),
        ("clearance", 2.0, "clearance is "),
        ("clearance_inter", 2.0, "clearance_inter is "),
        ("clearance_local", 1.5, "clearance_local is "),
        ("clearance", -1.0, "which proves nothing"),
    ],
)
def test_a_changed_number_is_found(run: Callable[..., Path], column: str, factor: float, words: str) -> None:
    path = run(bars(False))
    tamper(path, column, 3, factor * read_results(path).steps[column][3])
    assert words in only(path, step=3)[0]


def test_the_last_digits_of_numbers_may_differ(run: Callable[..., Path]) -> None:
    path = run(bars(False))
    for column in ("nu", "displacement_max"):
        tamper(path, column, 3, (1 + 1e-11) * read_results(path).steps[column][3])
    assert verify(path, sampling=EVERY).agrees


def test_a_changed_angle_is_found(run: Callable[..., Path]) -> None:
    path = run(bars(False), motion="rigid")
    tamper(path, "rotation_angle", 2, 1.0)
    assert only(path, step=2)[0].startswith("rotation_angle is 1 degrees in the file, and ")


def test_another_motion_is_found(run: Callable[..., Path]) -> None:
    path = run(bars(False), motion="rigid")
    with h5py.File(path, "a") as file:
        file.attrs["config"] = file.attrs["config"].replace('"rigid"', '"lab"')
    assert not verify(path).agrees


def test_a_certificate_of_a_crossing_is_found(run: Callable[..., Path]) -> None:
    path = run(bars(True))
    with h5py.File(path, "a") as file:
        for dataset in file["crossings"].values():
            dataset.resize(0, axis=0)
    tamper(path, "verdict", CROSSED, Verdict.CERTIFIED)
    tamper(path, "n_crossings", CROSSED, 0)
    tamper(path, "clearance", CROSSED, 0.1)
    sentences = only(path, step=CROSSED)
    assert any(
        text.startswith("it is CERTIFIED, but the referee finds a crossing that is not in the file: 1-2 through 5-6")
        for text in sentences
    )
    assert any("but edges pass through each other" in text for text in sentences)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("t", lambda t: t + 3e-7),
        ("parameters", lambda p: [p[0] + 3e-6, p[1]]),
        ("sign", lambda sign: -sign),
        ("image", lambda image: [0, 0, 1]),
        ("edges", lambda edges: [[0, 1], [5, 6]]),
    ],
)
def test_a_changed_crossing_is_found(run: Callable[..., Path], field: str, value: Callable[[Any], Any]) -> None:
    positions = bars(True)
    path = run(positions)
    crossing = true_crossing(positions)
    store_crossing(path, **{**crossing, field: value(crossing[field])})
    first, second = only(path, step=CROSSED)
    assert first.startswith("the referee does not find this crossing of the file: ")
    assert second.startswith(
        "it is CROSSING, but the referee finds a crossing that is not in the file: 1-2 through 5-6"
    )


def test_a_crossing_within_tolerance_agrees(run: Callable[..., Path]) -> None:
    positions = bars(True)
    path = run(positions)
    crossing = true_crossing(positions)
    s, r = crossing["parameters"]
    store_crossing(path, **{**crossing, "t": crossing["t"] + 5e-8, "parameters": [s + 5e-7, r]})
    assert verify(path, sampling=EVERY).agrees


def test_a_file_that_contradicts_itself_is_found(run: Callable[..., Path]) -> None:
    path = run(bars(False))
    tamper(path, "n_crossings", 2, 3)
    tamper(path, "verdict", 6, Verdict.UNRESOLVED)
    sentences = list(file_differences(read_results(path)))
    assert sentences[0] == "step 2 is said to have 3 crossings, and 0 are listed"
    assert "the summary counts 8 steps that are CERTIFIED, and the steps are 7" in sentences
    assert not verify(path, sampling=Sampling(steps=(0,))).agrees


def test_a_crossing_without_a_row_is_found(run: Callable[..., Path]) -> None:
    path = run(bars(False))
    tamper(path, "verdict", 2, Verdict.CROSSING)
    assert "it is CROSSING, but the file lists no crossing of it" in only(path, step=2)


# --- which steps ------------------------------------------------------------------------------------------------------


def results_of(verdicts: list[int], clearances: list[float], path: Path) -> Results:
    """Results without a trajectory: only the columns that the choice of steps looks at."""
    found = read_results(path)
    columns = {
        "verdict": np.array(verdicts, dtype=np.int8),
        "clearance": np.array(clearances),
        "n_crossings": np.zeros(len(verdicts), dtype=np.int64),
    }
    return replace(found, first_step=10, steps=columns)


def test_the_sample(run: Callable[..., Path]) -> None:
    path = run(bars(False))
    verdicts = [1] * 20
    verdicts[3], verdicts[5] = 2, 0
    found = results_of(verdicts, [float(30 - k) for k in range(20)], path)
    chosen, left = chosen_steps(path, found, Sampling(nearest=2, share=0.25, seed=1))
    kinds = {kind: [step for step, word in chosen.items() if word == kind] for kind in set(chosen.values())}
    assert kinds["crossing"] == [13]
    assert kinds["unresolved"] == [15]
    assert kinds["nearest"] == [28, 29]
    assert len(kinds["random"]) == 4  # a quarter of the other 16
    assert left == 0
    assert list(chosen) == sorted(chosen)
    assert chosen_steps(path, found, Sampling(nearest=2, share=0.25, seed=1))[0] == chosen
    assert chosen_steps(path, found, Sampling(nearest=2, share=0.25, seed=2))[0] != chosen
    assert chosen_steps(path, found, Sampling(nearest=2, share=0.25, most=3)) == (
        {13: "crossing", 28: "nearest", 29: "nearest"},
        5,
    )
    assert chosen_steps(path, found, Sampling(nearest=0, share=0.0))[0] == {13: "crossing", 15: "unresolved"}
    assert len(chosen_steps(path, found, Sampling(share=1.0))[0]) == 20
    assert chosen_steps(path, found, Sampling(steps=(12, 11, 12)))[0] == {11: "named", 12: "named"}
    with pytest.raises(InputError, match=r"has no step 9; it holds 20 steps from 10 on"):
        chosen_steps(path, found, Sampling(steps=(9,)))


def test_only_every_other_frame_is_compared_where_the_job_took_those(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", positions=bars(False), offsets=[0, 4, 8], closed=[False, False])
    monitor(tmp_path / "a.npz", out=tmp_path / "a.h5", frames=slice(1, None, 3))
    found = verify(tmp_path / "a.h5", sampling=EVERY)
    assert found.agrees
    assert found.n_steps == 2


# --- inputs -----------------------------------------------------------------------------------------------------------


def test_moved_and_changed_inputs(run: Callable[..., Path], tmp_path: Path) -> None:
    path, source = run(bars(False)), tmp_path / "run.npz"
    moved = tmp_path / "elsewhere.npz"
    source.rename(moved)
    with pytest.raises(InputError, match=r"run\.npz does not exist, and .* was made from it; name all"):
        verify(path)
    assert verify(path, [moved]).agrees
    with pytest.raises(InputError, match="was made from 1 file, and 2 are named"):
        verify(path, [moved, moved])
    content = moved.read_bytes()
    moved.write_bytes(content[:200] + bytes([content[200] ^ 1]) + content[201:])
    with pytest.raises(InputError, match="its content has changed"):
        verify(path, [moved])
    moved.write_bytes(content + b"x")
    with pytest.raises(InputError, match="its size has changed"):
        verify(path, [moved])


def test_a_file_that_was_touched_is_noted(run: Callable[..., Path], tmp_path: Path) -> None:
    import os

    path = run(bars(False))
    os.utime(tmp_path / "run.npz", (1e9, 1e9))
    (note,) = verify(path).notes
    assert "was written to since the run" in note


def test_results_of_an_array_need_a_file(tmp_path: Path) -> None:
    positions, out = bars(False), tmp_path / "a.h5"
    monitor(positions, strands=Strands.from_lengths([4, 4]), out=out)
    with pytest.raises(InputError, match="was made from an object in memory"):
        verify(out)
    np.savez(tmp_path / "a.npz", positions=positions, offsets=[0, 4, 8], closed=[False, False])
    found = verify(out, [tmp_path / "a.npz"])
    assert found.agrees
    assert "do not say from which files" in found.notes[0]
    np.savez(tmp_path / "b.npz", positions=positions, offsets=[0, 3, 8], closed=[False, False])
    with pytest.raises(InputError, match="not those of"):
        verify(out, [tmp_path / "b.npz"])


def test_a_trajectory_that_ends_too_soon(tmp_path: Path) -> None:
    positions, out = bars(False), tmp_path / "a.h5"
    monitor(positions, strands=Strands.from_lengths([4, 4]), out=out)
    np.savez(tmp_path / "a.npz", positions=positions[:5], offsets=[0, 4, 8], closed=[False, False])
    with pytest.raises(InputError, match=r"ends before frame 8"):
        verify(out, [tmp_path / "a.npz"], EVERY)


def test_the_request_is_used_to_open_the_input_again(run: Callable[..., Path]) -> None:
    found = read_results(run(bars(False)))
    assert found.request == {"select": None, "frames": [None, None, None], "reader": None, "reader_options": {}}
    paths, notes = input_files(Path("run.h5"), found, ())
    assert [path.name for path in paths] == ["run.npz"]
    assert notes == []


def test_images_that_cannot_be_counted(run: Callable[..., Path]) -> None:
    found = read_results(run(bars(False)))
    line = 3.0 * np.arange(8.0)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    frames = [Frame(k, float(k), line, np.diag([40.0, 0.2, 0.2])) for k in (0, 1)]
    check = check_step(found, 0, "named", *frames, periodic=True)
    assert check == StepCheck(0, "named", Verdict.CERTIFIED, ("it is CERTIFIED, but its images cannot be counted",))


@pytest.mark.parametrize(("clearance", "agrees"), [(1e-13, True), (1e-10, False)])
def test_what_hangs_on_rounding_is_noted_where_coordinates_are_turned(
    run: Callable[..., Path], clearance: float, agrees: bool
) -> None:
    for motion in ("rigid", "lab"):
        path = run(bars(True), motion=motion)
        with h5py.File(path, "a") as file:
            for dataset in file["crossings"].values():
                dataset.resize(0, axis=0)
            for name, value in (("verdict", Verdict.CERTIFIED), ("n_crossings", 0), ("clearance", clearance)):
                file[f"steps/{name}"][CROSSED] = value
            file["steps/curve_verdict"][CROSSED] = CurveVerdict.NONE
        (check,) = verify(path, sampling=Sampling(steps=(CROSSED,))).checks
        turned = motion == "rigid" and agrees
        assert bool(check.differences) is not turned
        assert ("rounding of turned coordinates" in check.note) is turned
