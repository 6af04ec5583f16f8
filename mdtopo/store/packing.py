"""The bytes of a chunk as they lie in the file: shuffled and compressed here, and not by HDF5.

A chunk is compressed whole, however few of its rows are filled, and in a short run that takes longer than all else
that is written. Most columns hold one value throughout, and that is compressed once.
"""

import math
import zlib
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

GZIP_LEVEL = 4
"""The usual one of h5py."""

MOSTLY_EMPTY = 16
"""A chunk is so called where its rows would fit into it so many times."""


def packed_chunks(rows: NDArray[Any], chunk_rows: int) -> list[bytes]:
    """Return the bytes of the chunks, of so many rows each, that the rows fill from the first on; see `packed`."""
    room = chunk_rows * math.prod(rows.shape[1:])
    return [packed(rows[done : done + chunk_rows], room) for done in range(0, len(rows), chunk_rows)]


def packed(rows: NDArray[Any], room: int) -> bytes:
    """Return the bytes of a chunk: what the filters shuffle and gzip of HDF5 make of it.

    Parameters
    ----------
    rows : ndarray, shape (n, ...)
        Its first rows, contiguous; the others are zeros, the fill value. Not for objects.
    room : int
        How many items the whole chunk has.
    """
    items = rows.reshape(-1).view(np.uint8).reshape(-1, rows.itemsize)
    if (items == items[0]).all():
        return _packed_equal(items[0].tobytes(), len(items), room)
    # in digits that were measured nothing comes again, and where most of the chunk is the zeros behind the last row,
    # little does: there runs alone give about as few bytes as the search for what came before, in half the time
    has_runs_only = rows.dtype.kind == "f" or MOSTLY_EMPTY * len(items) <= room
    return _compressed(items, room, zlib.Z_RLE if has_runs_only else zlib.Z_DEFAULT_STRATEGY)


@lru_cache(maxsize=256)
def _packed_equal(item: bytes, count: int, room: int) -> bytes:
    return _compressed(np.broadcast_to(np.frombuffer(item, np.uint8), (count, len(item))), room, zlib.Z_RLE)


def _compressed(items: NDArray[np.uint8], room: int, strategy: int) -> bytes:
    # the filter shuffle: first the first byte of every item, then the second of every item, and so on
    shuffled = np.zeros((items.shape[1], room), np.uint8)
    shuffled[:, : len(items)] = items.T
    stream = zlib.compressobj(GZIP_LEVEL, strategy=strategy)
    return stream.compress(shuffled.data) + stream.flush()
