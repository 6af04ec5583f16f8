import os
from pathlib import Path

import kernel_cache
import pytest
from hypothesis import settings

import mdtopo

settings.register_profile("ci", derandomize=True, deadline=None)
settings.load_profile("ci")

if Path(mdtopo.__file__).parents[1] != Path(__file__).parents[1]:
    # programs that tests start import the mdtopo under test too, and not the sources in the working directory, whose
    # kernels nobody has compiled
    os.environ["PYTHONSAFEPATH"] = "1"

ORDINARY = "not slow and not benchmark"
MOST_WORKERS = 4
"""Each of them holds more than a gigabyte of compiled kernels at the end."""


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Return in how many processes tests run: what prints, or is asked for by name, runs in this one alone."""
    whole = config.args_source is config.ArgsSource.TESTPATHS
    if config.option.capture == "no" or config.option.markexpr != ORDINARY or not whole:
        return 0
    return min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1, MOST_WORKERS)


def pytest_sessionstart(session: pytest.Session) -> None:
    config = session.config
    if config.option.numprocesses and not hasattr(config, "workerinput") and not config.option.collectonly:
        kernel_cache.compile_all()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"the trajectories of real engines are not at {folder}")
    return folder
