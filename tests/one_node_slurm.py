"""A SLURM of one node on the loopback address, with a configuration of its own that lives as long as a test."""

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

DAEMONS = ("slurmctld", "slurmd")
CLIENTS = ("sbatch", "scancel", "scontrol", "sinfo", "squeue", "srun")

CONFIGURATION = """\
ClusterName=mdtopo
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/none
CredType=cred/none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobCompType=jobcomp/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_min_interval=0,bf_interval=1
ReturnToService=2
KillWait=5
MinJobAge=3600
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory=8000 State=UNKNOWN
PartitionName=main Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


class OneNodeSlurm:
    """A running SLURM; `path` is a PATH whose SLURM commands talk to it.

    The commands are wrapped so that each of them sets SLURM_CONF itself: the Snakemake plugin takes every variable
    that begins with SLURM_ out of the environment of its jobs.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        wrappers = folder / "bin"
        wrappers.mkdir()
        for name in CLIENTS:
            wrapper = wrappers / name
            wrapper.write_text(f'#!/bin/sh\nSLURM_CONF={folder}/slurm.conf exec {shutil.which(name)} "$@"\n')
            wrapper.chmod(0o755)
        self.path = f"{wrappers}{os.pathsep}{os.environ['PATH']}"

    def ask(self, *words: str) -> str:
        """Return what a SLURM command prints."""
        command = [str(self.folder / "bin" / words[0]), *words[1:]]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
        assert done.returncode == 0, f"{words}: {done.stderr}"
        return done.stdout.strip()

    def wait_until_idle(self, seconds: float) -> None:
        """Wait until no job is queued or runs."""
        wait_for(lambda: not self.ask("squeue", "--noheader"), seconds, lambda: self.ask("squeue"))


def wait_for(condition: Callable[[], bool], seconds: float, describe: Callable[[], str]) -> None:
    """Wait until a condition holds, or fail with a description."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s: {describe()}"
        time.sleep(0.2)


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


@contextmanager
def one_node_slurm(folder: Path) -> Iterator[OneNodeSlurm]:
    """Start SLURM's two daemons, and end them and every job in the end; skip the test where they are missing."""
    missing = [name for name in (*DAEMONS, *CLIENTS) if shutil.which(name) is None]
    if missing:
        pytest.skip(f"SLURM is not installed ({missing[0]} is missing; Debian: slurmctld slurmd slurm-client)")
    for name in ("state", "spool"):
        (folder / name).mkdir(parents=True)
    host = socket.gethostname().partition(".")[0]
    user = subprocess.run(["id", "-un"], capture_output=True, text=True, check=True).stdout.strip()
    configuration = CONFIGURATION.format(host=host, user=user, folder=folder, ports=_free_ports(2))
    (folder / "slurm.conf").write_text(configuration)
    (folder / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")
    slurm = OneNodeSlurm(folder)
    environment = {**os.environ, "PATH": slurm.path, "SLURM_CONF": str(folder / "slurm.conf")}
    running = []
    try:
        for words in (["slurmctld", "-D"], ["slurmd", "-D", "-N", host]):
            with (folder / f"{words[0]}.out").open("w") as output:
                running.append(subprocess.Popen(words, stdout=output, stderr=output, env=environment))
        wait_for(lambda: _is_idle(slurm), 30, lambda: _logs(folder))
        yield slurm
        slurm.ask("scancel", "--full", f"--user={user}")
        slurm.wait_until_idle(30)
    finally:
        for daemon in reversed(running):
            daemon.terminate()
        for daemon in running:
            try:
                daemon.wait(20)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()


def _is_idle(slurm: OneNodeSlurm) -> bool:
    try:
        return slurm.ask("sinfo", "--noheader", "--format=%T") == "idle"
    except AssertionError:  # the controller does not answer yet
        return False


def _logs(folder: Path) -> str:
    return "\n".join(path.read_text()[-2000:] for path in sorted(folder.glob("slurm*.out")))
