"""The story of a step: its numbers are those of the results, and every verdict has its words."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mdtopo
from mdtopo.errors import InputError
from mdtopo.explanation import CLASSES, REASONS, RUNGS, VERDICTS, explain, step_of_frame
from mdtopo.records import MonitorConfig, PairClass, Reason, Rung, Strands, Verdict
from mdtopo.store import Results, read_results


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """Two bars: they rest, one passes through the other in step 1 by a long way, and a frame is damaged at the end."""
    bars = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 2.0], [0, 1, 2.0]])
    frames = np.stack([bars] * 6)
    frames[:2, 2:, 2] += [[0.0], [0.5]]
    frames[2:, 2:, 2] -= 4.0
    frames[4, 1, 0] = np.nan
    path = tmp_path_factory.mktemp("story") / "run.h5"
    lab = MonitorConfig(motion="lab")
    mdtopo.monitor(frames, strands=Strands.from_lengths([2, 2]), out=path, frames=slice(0, None), config=lab)
    return read_results(path)


def story(results: Results, step: int) -> dict[str, str]:
    return {section.title: "\n".join(section.sentences) for section in explain(results, step)}


def test_every_value_has_its_words() -> None:
    assert set(VERDICTS) == set(Verdict)
    assert set(RUNGS) == set(Rung)
    assert set(REASONS) == set(Reason) - {Reason.NONE}
    assert set(CLASSES) == set(PairClass) - {PairClass.NONE}


def test_a_certified_step(results: Results) -> None:
    told = story(results, 0)
    assert "CERTIFIED" in told["Verdict"]
    assert "frames 0 and 1" in told["Verdict"]
    assert "2 of strand 1: 0.5 Å" in told["What moved"]
    assert "is 2 Å" in told["The paper's comparison"]
    assert "2m/ν = 2 x 0.5 / 2 = 0.5; below 1, which alone proves the step." in told["The paper's comparison"]
    assert "different strands: proved to stay at least 2 Å apart, 0-1 x 2-3." in told["How near pairs came"]
    assert "one strand, further apart: there is no such pair." in told["How near pairs came"]
    assert "rung 0" in told["What decided"]
    assert "Crossings" not in told


def test_a_crossing_with_time_place_sign_and_grade(results: Results) -> None:
    told = story(results, 1)
    assert "CROSSING" in told["Verdict"]
    (crossing,) = results.crossings
    assert crossing.t == pytest.approx(2.5 / 4.5)
    assert f"t = {crossing.t:.6g}" in told["Crossings"]
    assert f"sign {crossing.sign:+d}" in told["Crossings"]
    assert "0.500 and 0.500 along the edges, at (0, 0, 0) Å" in told["Crossings"]
    assert "undersampled" in told["Crossings"]
    assert told["What would settle it"].startswith("Frames closer together would tell")
    assert "critical" not in told["Alerts that touch the step"]
    assert "warning, crossing: Step 1" in told["Alerts that touch the step"]


def test_a_step_that_is_not_measured_says_why_and_gives_no_numbers(results: Results) -> None:
    told = story(results, 3)
    assert "UNRESOLVED" in told["Verdict"]
    assert "Reason BAD_DATA: one of the two frames cannot be used." in told["Verdict"]
    assert "nan" not in "".join(told.values()).replace("nan,", "")
    assert "What moved" not in told
    assert "frame 4: 1 vertex has a coordinate that is not finite" in told["Alerts that touch the step"]


@pytest.mark.parametrize("step", [-1, 5, 99])
def test_a_step_that_is_not_there_is_named_with_the_valid_range(results: Results, step: int) -> None:
    with pytest.raises(InputError, match=f"have no step {step}; they hold the steps 0 to 4"):
        explain(results, step)


def test_the_step_of_a_frame_begins_there_and_of_the_last_ends_there(results: Results) -> None:
    assert [step_of_frame(results, frame) for frame in range(6)] == [0, 1, 2, 3, 4, 4]
    with pytest.raises(InputError, match="No step begins or ends at frame 6; the analysed frames lie from 0 to 5"):
        step_of_frame(results, 6)


def test_the_curve_has_a_story_of_its_own(results: Results) -> None:
    told = story(results, 0)["The smooth curve"]
    assert "(interpolating). CERTIFIED" in told
    assert "in its sound form is 0 (below 1" in told  # the bars do not turn
    assert "Every check is settled by hulls alone" in told
    told = story(results, 1)["The smooth curve"]
    (crossing,) = results.curve_crossings
    assert f"The curve of strand 0 passes through strand 1 at 0-1 x 2-3, t = {crossing.t:.6g}" in told
    assert "the two segments move" in told
    assert "no crossing there" not in told
    assert "Reason BAD_DATA: one of the two frames cannot be used." in story(results, 3)["The smooth curve"]


def test_where_no_curve_was_looked_at(results: Results) -> None:
    none = {"curve_verdict": np.full(5, -1), "curve_reason": np.zeros(5), "curve_d_star": np.full(5, np.nan)}
    without = replace(results, steps={**results.steps, **none})
    assert story(without, 0)["The smooth curve"] == "The curve. It was not looked at (--curve none)."
    older = {name: column for name, column in results.steps.items() if not name.startswith("curve_")}
    assert "The smooth curve" not in story(replace(results, steps=older), 0)


def test_real_crossing(tmp_path: Path) -> None:
    data = Path(__file__).parents[2].parent / "shared" / "data" / "rings"
    if not data.is_dir():
        pytest.skip(f"the trajectories of shared/data are not beside the repository: {data} is missing")
    out, lab = tmp_path / "run.h5", MonitorConfig(motion="lab")
    mdtopo.monitor(data / "hopf.data", data / "pair_hopf_fine.dcd", out=out, frames=slice(480, 500), config=lab)
    results = read_results(out)
    told = story(results, step_of_frame(results, 489))
    assert "molecule 1 passes through molecule 2 at 1:63-64 x 2:98-99, t = 0.213" in told["Crossings"]
    assert "proven" in told["Crossings"]
    assert "nothing is open" in told["What would settle it"]
