"""The trajectory of a results file, opened again: the file stores no coordinates, and names what it was made from."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from mdtopo.errors import InputError, MissingFileError
from mdtopo.readers import Reader, ReaderRequest, Source, open_reader
from mdtopo.records import Frame
from mdtopo.store import Results, fingerprint


def input_files(results: Path, found: Results, given: Sequence[Path]) -> tuple[list[Path], list[str]]:
    """Return the input files, and what is to be said of them.

    Parameters
    ----------
    results : Path
        The results file.
    found : Results
        What it holds.
    given : sequence of Path
        Where the files are now; by default the stored paths.

    Raises
    ------
    InputError
        If one is missing (`MissingFileError`), or is not as it was.
    """
    stored = found.provenance["inputs"]
    if not stored and not given:
        raise InputError(f"{results} was made from an object in memory; name the topology and the trajectory.")
    if stored and given and len(stored) != len(given):
        raise InputError(
            f"{results} was made from {len(stored)} {'file' if len(stored) == 1 else 'files'}, and {len(given)} "
            f"{'is' if len(given) == 1 else 'are'} named; name all in order, or none."
        )
    paths = [Path(path) for path in given] or [Path(entry["path"]) for entry in stored]
    notes = (
        [] if stored else ["the results do not say from which files they were made, so nobody knows if these are it"]
    )
    for path, entry in zip(paths, stored, strict=bool(stored)):
        if not path.exists():
            raise MissingFileError(
                f"{path} does not exist, and {results} was made from it; name all input files, in their order, where "
                "they are now."
            )
        now = fingerprint(path)
        for key, word in (("size", "size"), ("sha256_of_size_and_first_and_last_mebibyte", "content")):
            if getattr(now, key) != entry[key]:
                grows = " A trajectory that still grows can be read again when its run has ended." * found.in_progress
                raise InputError(f"{path} is not the file that {results} was made from: its {word} has changed.{grows}")
        if now.path == entry["path"] and now.modified != entry["modified"]:
            notes.append(f"{path} was written to since the run; size, beginning and end are as they were")
    return paths, notes


def open_again(results: Path, found: Results, paths: Sequence[Path]) -> Reader:
    """Return an open reader of the input files, with the selection and the options of the run.

    Parameters
    ----------
    results, found
        The results file and what it holds.
    paths : sequence of Path
        As `input_files` returns them.

    Raises
    ------
    InputError
        If they cannot be opened, or hold other strands than the results.
    """
    request = ReaderRequest(found.request.get("select"), dict(found.request.get("reader_options") or {}))
    reader = open_reader(Source(paths=tuple(paths)), request, reader=found.request.get("reader"))
    ours, theirs = found.strands, reader.strands
    atoms = ours.labels.atom_index, theirs.labels.atom_index
    pairs = ((ours.offsets, theirs.offsets), (ours.closed, theirs.closed), atoms)
    if not all(np.array_equal(one, other) for one, other in pairs):
        reader.close()
        raise InputError(f"The strands of the input are not those of {results}; was it made with another selection?")
    return reader


def frames_at(reader: Reader, indices: list[int]) -> Iterator[Frame]:
    """Yield these frames, which rise, in order; a stream is read through for them.

    Raises
    ------
    InputError
        When the trajectory ends before the last of them, and a frame more is asked for.
    """
    if reader.n_frames is None:
        wanted = set(indices)
        yield from (frame for frame in reader.frames() if frame.index in wanted)
    else:
        for index in indices:
            yield from reader.frames(index, index + 1, 1)
    raise InputError(f"The trajectory ends before frame {indices[-1]}, which the results speak of.")
