import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from mdtopo.errors import OutputError
from mdtopo.pipeline.prometheus import metrics_text, write_metrics
from mdtopo.records import CurveCounts, Grade, RunSummary, RunVerdict, Severity, StepCounts

SAMPLE = re.compile(r'^(?P<name>[a-z_]+)\{(?P<labels>([a-z_]+="([^"\\\n]|\\.)*",?)+)\} (?P<value>\S+)$')


def summary(clearance: float = 1.25) -> RunSummary:
    alerts = dict(zip(Severity, (3, 2, 1), strict=True))
    return RunSummary(
        RunVerdict.FAIL, StepCounts(5, 4, 3, 2, 1), dict.fromkeys(Grade, 0), 1, alerts, clearance, 0, 0.9, 4
    )


def values(text: str) -> dict[str, float]:
    found = {}
    for line in text.splitlines():
        if not line.startswith("#"):
            match = SAMPLE.match(line)
            assert match, line
            found[f"{match['name']}{{{match['labels']}}}"] = float(match["value"])
    return found


def test_every_number_of_the_summary_has_its_line() -> None:
    found = values(metrics_text(summary(), run="a", is_running=True))
    assert found['mdtopo_steps_total{run="a"}'] == 15
    outcomes = {name: value for name, value in found.items() if name.startswith("mdtopo_outcome_steps_total")}
    assert sorted(outcomes.values()) == [1, 2, 3, 4, 5]
    assert found['mdtopo_alerts_total{run="a",severity="critical"}'] == 1
    assert found['mdtopo_least_clearance_angstroms{run="a"}'] == 1.25
    assert found['mdtopo_running{run="a"}'] == 1
    verdicts = {name: value for name, value in found.items() if name.startswith("mdtopo_verdict")}
    assert [name for name, value in verdicts.items() if value] == ['mdtopo_verdict{run="a",verdict="FAIL"}']
    assert len(verdicts) == len(RunVerdict)


def test_the_curve_has_lines_of_its_own_where_it_was_looked_at() -> None:
    assert not [name for name in values(metrics_text(summary(), run="a", is_running=True)) if "curve" in name]
    with_curve = replace(summary(), curve=CurveCounts(certified=9, flat=8, unresolved=4, crossed=2))
    found = values(metrics_text(with_curve, run="a", is_running=True))
    assert [value for name, value in found.items() if name.startswith("mdtopo_curve_outcome")] == [9, 4, 2]


def test_what_is_not_known_is_nan() -> None:
    found = values(metrics_text(summary(math.nan), run="a", is_running=False))
    assert math.isnan(found['mdtopo_least_clearance_angstroms{run="a"}'])
    assert found['mdtopo_running{run="a"}'] == 0


def test_a_name_cannot_break_its_line() -> None:
    text = metrics_text(summary(), run='a"} 1\nb\\', is_running=True)
    assert len(values(text)) == len([line for line in text.splitlines() if not line.startswith("#")])
    assert 'run="a\\"} 1\\nb\\\\"' in text


def test_the_file_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "mdtopo.prom"
    path.write_text("old")
    with path.open() as held:
        write_metrics(path, summary(), run="a", is_running=True)
        assert held.read() == "old"  # who reads it now still sees the file as it was
    assert path.read_text() == metrics_text(summary(), run="a", is_running=True)
    assert [entry.name for entry in tmp_path.iterdir()] == ["mdtopo.prom"]


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"metrics file .* cannot be written"):
        write_metrics(tmp_path / "none" / "mdtopo.prom", summary(), run="a", is_running=True)
