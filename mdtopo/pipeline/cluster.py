"""A Dask cluster that is running already: found, and looked at before hours of work are given to it."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any

from mdtopo.errors import ClusterError, MissingDependencyError

CONNECT_SECONDS = 20.0
"""How long a scheduler may take to answer."""

LOST_WORKER = (
    "its worker died each time that it was tried; that worker's log says more (it may have run out of memory, or of "
    "the time that the batch system gave it)"
)


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Give a client of the scheduler at an address, and let go of it in the end.

    Raises
    ------
    MissingDependencyError
        If dask.distributed is not installed.
    ClusterError
        If no scheduler answers there.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingDependencyError(
            f"A Dask cluster needs the package distributed ({error}); install it: pip install 'mdtopo[dask]'."
        ) from error
    with _quiet():
        try:
            client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ClusterError(
                f"No Dask scheduler answers at {address} ({error or 'no answer in time'}); give the address that "
                "'dask scheduler' prints, such as tcp://host:8786."
            ) from error
        try:
            with client.as_current():
                yield client
        finally:
            client.close()


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's client from logging tracebacks of what is said in one sentence here."""
    loggers = [logging.getLogger(name) for name in ("distributed.client", "distributed.comm", "distributed.core")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def check_workers(client: Any) -> int:
    """Return how many tasks the present workers do at once: 0 where none has come yet.

    Raises
    ------
    ClusterError
        If a worker lacks mdtopo, or has another version of it, which need not give the same bits.
    """
    own = version("mdtopo")
    for worker, found in client.get_versions(packages=["mdtopo"])["workers"].items():
        there = found["packages"]["mdtopo"] if isinstance(found, dict) else None
        if there is None:
            raise ClusterError(f"The Dask worker {worker} has no mdtopo; install mdtopo {own} where workers run.")
        if there != own:
            raise ClusterError(f"The Dask worker {worker} has mdtopo {there}, and this is {own}; install the same one.")
    return sum(client.nthreads().values())
