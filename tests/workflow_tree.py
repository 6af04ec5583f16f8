"""A copy of the workflow's small case, and an ``mdtopo`` on the PATH that is the one under test."""

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import mdtopo

REPOSITORY = Path(__file__).parents[1]
WORKFLOWS = REPOSITORY / "workflows"


@dataclass(frozen=True)
class Tree:
    """The folder `workflows` of the copy, and the environment in which commands run there."""

    folder: Path
    environment: dict[str, str]

    @property
    def results(self) -> Path:
        return self.folder / ".test" / "results"

    def run(self, *words: str, seconds: float = 600, **changes: str) -> subprocess.CompletedProcess[str]:
        """Run a command in the copy; when it takes too long, it ends with everything that it started."""
        with subprocess.Popen(
            list(words), cwd=self.folder, env={**self.environment, **changes}, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        ) as process:  # fmt: skip
            try:
                out, err = process.communicate(timeout=seconds)
            except BaseException:
                os.killpg(process.pid, signal.SIGKILL)
                raise
        return subprocess.CompletedProcess(list(words), process.returncode, out, err)


def copied_tree(folder: Path) -> Tree:
    """Return a copy of the workflow with its small case."""
    ignored = shutil.ignore_patterns(".snakemake", "results", ".*_offsets.*")
    shutil.copytree(WORKFLOWS, folder / "workflows", ignore=ignored)
    package = Path(mdtopo.__file__).parent
    (folder / "mdtopo").mkdir()
    shutil.copytree(package / "demo", folder / "mdtopo" / "demo")
    command = folder / "bin" / "mdtopo"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nPYTHONPATH={package.parent} exec {sys.executable} -m mdtopo "$@"\n')
    command.chmod(0o755)
    found_first = [str(command.parent), str(Path(sys.executable).parent), os.environ["PATH"]]
    return Tree(folder / "workflows", {**os.environ, "PATH": os.pathsep.join(found_first)})
