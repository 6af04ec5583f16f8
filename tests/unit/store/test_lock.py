"""The lock of an output on file systems that have none: who lives on this machine is noticed all the same."""

import errno
import fcntl
import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mdtopo.errors import OutputError
from mdtopo.store import OutputLock
from mdtopo.store.lock import UNSUPPORTED, is_held

ROOT = Path(__file__).parents[3]
DEAD = 2**22 + 1
"""No process has it: Linux numbers them up to 2^22."""

HOLDER = """\
import errno, fcntl, sys, time
from pathlib import Path

def without(*_):
    raise OSError(errno.ENOLCK, "No locks available")

fcntl.lockf = without
from mdtopo.errors import OutputError
from mdtopo.store import OutputLock
sys.stdin.readline()
try:
    held = OutputLock(Path(sys.argv[1]), Path("run.h5"))
except OutputError as error:
    sys.exit(str(error))
print("held", flush=True)
sys.stdin.readline()
held.release()
"""


@pytest.fixture
def lock(tmp_path: Path) -> Path:
    return tmp_path / "lock"


def refuse(number: int) -> Callable[..., object]:
    def fail(*_: object) -> object:
        raise OSError(number, os.strerror(number))

    return fail


@pytest.fixture(params=UNSUPPORTED, ids=lambda number: errno.errorcode[number])
def _without_locks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fcntl, "lockf", refuse(request.param))
    monkeypatch.setattr(fcntl, "fcntl", refuse(request.param))


def held_by(lock: Path, pid: int, host: str = socket.gethostname()) -> None:
    lock.write_text(json.dumps({"host": host, "pid": pid}))


@pytest.mark.usefixtures("_without_locks")
def test_without_locks_the_living_are_noticed_and_the_dead_are_not(lock: Path) -> None:
    with OutputLock(lock, Path("run.h5")):
        assert json.loads(lock.read_text()) == {"host": socket.gethostname(), "pid": os.getpid()}
        assert is_held(lock)
    assert not lock.exists()
    held_by(lock, os.getppid())
    assert is_held(lock)
    with pytest.raises(OutputError, match=rf"run\.h5 is being written by process {os.getppid()} on "):
        OutputLock(lock, Path("run.h5"))
    held_by(lock, DEAD)
    assert not is_held(lock)
    with OutputLock(lock, Path("run.h5")):
        pass


@pytest.mark.usefixtures("_without_locks")
def test_without_locks_another_machine_is_not_noticed_by_a_writer(lock: Path) -> None:
    """A job that was killed there could not go on here else; who only looks is told that it may live."""
    held_by(lock, DEAD, "another-machine")
    assert is_held(lock)
    with OutputLock(lock, Path("run.h5")):
        pass


@pytest.mark.usefixtures("_without_locks")
@pytest.mark.parametrize("text", ["", "{", "[]", '{"host": 3}', '{"host": "a", "pid": "b"}'])
def test_without_locks_a_file_that_names_nobody_stands_in_nobodys_way(lock: Path, text: str) -> None:
    lock.write_text(text)
    assert not is_held(lock)
    with OutputLock(lock, Path("run.h5")):
        pass


@pytest.mark.parametrize("number", [errno.EACCES, errno.EAGAIN, errno.EDEADLK])
def test_any_other_answer_is_a_refusal(lock: Path, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fcntl, "lockf", refuse(number))
    with pytest.raises(OutputError, match="by another process"):
        OutputLock(lock, Path("run.h5"))


@pytest.fixture
def holders(lock: Path) -> Iterator[list[subprocess.Popen[str]]]:
    """Three processes without locks, each of which takes the output when it is sent a line."""
    words = [sys.executable, "-c", HOLDER, str(lock)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    started = [subprocess.Popen(words, cwd=ROOT, text=True, **pipes) for _ in range(3)]
    yield started
    for process in started:
        process.kill()
        process.communicate()


def test_of_processes_that_begin_at_one_moment_without_locks_one_has_the_output(
    holders: list[subprocess.Popen[str]], lock: Path
) -> None:
    for process in holders:
        process.stdin.write("\n")
    for process in holders:
        process.stdin.flush()
    said = {process.pid: process.stdout.readline() for process in holders}
    (winner,) = (pid for pid, line in said.items() if line == "held\n")
    assert json.loads(lock.read_text())["pid"] == winner
    for process in holders:
        if process.pid != winner:
            assert process.wait(30) == 1
            assert f"run.h5 is being written by process {winner} on " in process.stderr.read()
