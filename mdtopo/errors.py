"""The exceptions that mdtopo raises on purpose.

::

    MdtopoError
    ├── InputError (ValueError)            exit code 4: the input cannot be used
    │   ├── MissingFileError (FileNotFoundError)
    │   ├── MissingDependencyError (ImportError)
    │   ├── UnknownFormatError             no installed reader takes this input
    │   ├── TrajectoryError (OSError)      a frame, or the whole file, cannot be read
    │   ├── SelectionError                 the selection matches nothing, or is malformed
    │   ├── StrandError                    the selected atoms do not form strands
    │   └── OptionError                    an unknown reader option or configuration key
    ├── OutputError (OSError)              exit code 4: the output cannot be written
    ├── ClusterError (RuntimeError)        exit code 4: a Dask cluster cannot be used, or has lost a task
    └── AuditError (AssertionError)        exit code 1: mdtopo contradicts itself, a bug

A message is one sentence or two: the subject (file, frame, vertex), what was found, what was expected, and the
cure where it is known. An inconclusive step is not an error: it is the value ``Verdict.UNRESOLVED``.
"""


class MdtopoError(Exception):
    """Base of every error that mdtopo raises on purpose."""


class InputError(MdtopoError, ValueError):
    """The input cannot be used."""


class MissingFileError(InputError, FileNotFoundError):
    """A named input file does not exist."""


class MissingDependencyError(InputError, ImportError):
    """The input needs a package that is not installed."""


class UnknownFormatError(InputError):
    """No installed reader takes the input."""


class TrajectoryError(InputError, OSError):
    """A trajectory, or one of its frames, cannot be read."""


class SelectionError(InputError):
    """A selection matches nothing, or is malformed."""


class StrandError(InputError):
    """The selected atoms do not form strands."""


class OptionError(InputError):
    """An option or configuration key is unknown, or its value is out of range."""


class OutputError(MdtopoError, OSError):
    """The output cannot be written, or exists already."""


class ClusterError(MdtopoError, RuntimeError):
    """A Dask cluster cannot be used, or a task was not done by it."""


class AuditError(MdtopoError, AssertionError):
    """Two independent computations of mdtopo disagree: a bug, reported loudly."""
