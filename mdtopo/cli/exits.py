"""How a command ends: exit codes, and the sentence for each error. Tracebacks are for developers only."""

import errno
import os
import signal
import sys
import traceback
from contextlib import suppress
from enum import IntEnum
from typing import IO

from mdtopo.errors import ClusterError, InputError, OutputError

DEBUG_VARIABLE = "MDTOPO_DEBUG"
"""Environment variable that, set to anything, shows tracebacks."""


class Exit(IntEnum):
    """The exit codes of every command."""

    DONE = 0
    INTERNAL = 1
    USAGE = 2
    ALERTS = 3
    BAD_INPUT = 4
    DIFFERS = 5
    CHECKPOINT = 75  # EX_TEMPFAIL
    INTERRUPTED = 130  # 128 + SIGINT, as shells count
    BROKEN_PIPE = 141  # 128 + SIGPIPE


EXIT_HELP = """\
exit codes:
  0    done, whatever was found
  1    internal error of mdtopo
  2    the command line is wrong
  3    alerts at or above --fail-on were raised
  4    bad input, or output that cannot be written; also a trajectory that
       could be read in part only (the results are kept, marked as incomplete),
       and a Dask cluster that fails
  5    'mdtopo verify' found a difference
  75   put down on a signal or --max-hours, with all that was measured: run the
       same command again to go on
  130  interrupted from the keyboard
"""


FULL_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What systems answer where no more can be written."""


def say(text: str) -> None:
    """Write one line to standard error, after the name of the program."""
    write_log(sys.stderr, f"mdtopo: {text}\n")


def write_log(stream: IO[str], text: str) -> None:
    """Write to a log, such as standard error; what it cannot take is lost.

    A log on a full disk, or one that nobody reads any more, must neither end a run nor change its exit code.
    """
    with suppress(OSError):
        stream.write(text)
        stream.flush()


def ignore_late_signals() -> None:
    """Ignore what a batch system sends from now on: all is done, and the exit code must say so.

    Python takes a while to shut down, and a signal would end it with a code that says the work was lost.
    """
    for name in ("SIGTERM", "SIGUSR1"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


def close_log() -> None:
    """Forget what standard error could not take, which the interpreter would try once more, and end with code 120."""
    try:
        sys.stderr.flush()
    except OSError:
        _forget(sys.stderr)


def exit_code(error: BaseException, *, show_traceback: bool) -> Exit:
    """Return the exit code for an error that ended a command, and say the error in one sentence."""
    if _is_broken_pipe(error):
        _forget(sys.stdout)
        return Exit.BROKEN_PIPE
    if show_traceback or os.environ.get(DEBUG_VARIABLE):
        write_log(sys.stderr, "".join(traceback.format_exception(error)))
    if isinstance(error, KeyboardInterrupt):
        say(" ".join(["interrupted.", *getattr(error, "__notes__", [])]))
        return Exit.INTERRUPTED
    if isinstance(error, InputError | OutputError | ClusterError):
        say(str(error))
        return Exit.BAD_INPUT
    if isinstance(error, OSError) and error.errno in FULL_DISK:  # of files mdtopo's own error speaks
        _forget(sys.stdout)
        say(f"standard output cannot be written ({error.strerror}); what was finished is kept.")
        return Exit.BAD_INPUT
    if "no locator available" in str(error):  # numba's words, when it is imported
        say("numba finds no directory where it may keep compiled kernels; set NUMBA_CACHE_DIR to one.")
        return Exit.BAD_INPUT
    first_line = next(iter(str(error).splitlines()), "")
    say(
        f"internal error: {type(error).__name__}: {first_line}\n"
        "mdtopo: this is a fault of mdtopo, not of your input. Please report it with the command and its output when "
        f"{DEBUG_VARIABLE}=1 is set."
    )
    return Exit.INTERNAL


def _is_broken_pipe(error: BaseException) -> bool:
    """Return whether whoever read our standard output has gone away, as ``| head`` does."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, BrokenPipeError) or (isinstance(cause, OSError) and cause.errno == errno.EPIPE):
            return True
        cause = cause.__cause__
    return False


def _forget(stream: IO[str]) -> None:
    # the interpreter flushes its streams once more at its end, and would print an error of its own
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
