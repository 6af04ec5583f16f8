"""Pages of real runs in a browser, wide and narrow: no network, no error, nothing cut or wider than the screen."""

import re
import time
from pathlib import Path

import browser
import pytest

from mdtopo import MonitorConfig, monitor, read_results
from mdtopo.cli import main
from mdtopo.reporting import write_report

needs_browser = pytest.mark.skipif(bool(browser.missing()), reason=browser.missing() or "a browser is there")

RUNS = {
    "soft_fine": (("soft/soft.data", "soft/soft_fine.dcd"), "lab"),
    "pair_hopf": (("rings/hopf.data", "rings/pair_hopf_fine.dcd"), "rigid"),
    "dup_pull": (("fracture/duplex.data", "fracture/dup_pull.dcd"), "rigid"),
    "ca_wrapped": (("gmx/ca.gro", "gmx/ca_wrapped.xtc"), "rigid"),
}

# what is cut: text wider than its box, where the box does not show it
CUT = """
return [...document.querySelectorAll('h1, h2, h3, p, dt, dd, th, td, li, summary, label, output, button')]
  .filter((e) => e.offsetParent && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== 'inline')
  .map((e) => e.textContent.slice(0, 60));
"""


def look(page: browser.Page, file: Path, width: int) -> None:
    assert page.open(file) < 20.0
    time.sleep(1.0)
    assert page.errors() == []
    assert page.requests() == []
    assert page.run("return document.documentElement.scrollWidth") <= width
    assert page.run(CUT) == []
    names = page.run(
        "return [...document.querySelectorAll('.yaxislayer-above text, .ytick text')].map((e) => "
        "[e.textContent, e.getBoundingClientRect().left, e.closest('.plot').getBoundingClientRect().left])"
    )
    assert names
    assert [text for text, left, edge in names if left < edge - 1.0] == []  # of an axis, cut at the left


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("name", [*RUNS, "demo"])
def test_a_page_of_a_real_run(shared_data: Path, tmp_path: Path, name: str) -> None:
    if name == "demo":
        assert main(["demo", "-d", str(tmp_path)]) == 0
        out, page_file = tmp_path / "run.h5", tmp_path / "run.html"
    else:
        (topology, trajectory), motion = RUNS[name]
        out, page_file = tmp_path / f"{name}.h5", tmp_path / f"{name}.html"
        config = MonitorConfig(motion=motion)  # type: ignore[arg-type]
        monitor(shared_data / topology, shared_data / trajectory, out=out, config=config)
        write_report(out, page_file)
    text = page_file.read_text()
    assert len(text.encode()) < 8_000_000
    counts = [int(n) for n in re.findall(r'<td class="number" data-count="[^"]*">(\d+)</td>', text)]
    assert sum(counts) == len(read_results(out).steps["verdict"])
    assert len(counts) == 5
    with browser.browser(tmp_path / "profile") as page:
        look(page, page_file, 1280)
        if read_results(out).summary["counts"]["crossed"]:
            shown = page.run("return document.querySelector('.controls output').textContent")
            assert "distance 0.0000 Å" in shown
        metrics = {"width": 400, "height": 850, "deviceScaleFactor": 1, "mobile": True}
        page.devtools("Emulation.setDeviceMetricsOverride", metrics)
        look(page, page_file, 400)
