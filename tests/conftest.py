import os
from pathlib import Path

import pytest
from hypothesis import settings

import mdtopo

settings.register_profile("ci", derandomize=True, deadline=None)
settings.load_profile("ci")

if Path(mdtopo.__file__).parents[1] != Path(__file__).parents[1]:
    # programs that tests start import the mdtopo under test too, and not the sources in the working directory, whose
    # kernels nobody has compiled
    os.environ["PYTHONSAFEPATH"] = "1"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    folder = Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"the trajectories of real engines are not at {folder}")
    return folder
