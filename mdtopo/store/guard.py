"""A file under HDF5 that survives a full disk."""

import os


class GuardedFile:
    """A file object for h5py that keeps a failed write to itself.

    HDF5 cannot close a file after a write to it has failed, and crashes the process at its exit (segmentation
    fault, seen with h5py 3.16). So the first error is remembered in `error`, and from then on everything is
    kept in memory instead, where HDF5 finds it again and can close in peace. Whoever writes looks at `error`
    after every flush, and stops.

    Parameters
    ----------
    descriptor : int
        An empty file, open for reading and writing; whoever opened it closes it.
    """

    def __init__(self, descriptor: int) -> None:
        self.error: OSError | None = None
        self._descriptor = descriptor
        self._position = 0
        self._size = 0
        self._kept: list[tuple[int, bytes]] = []

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to a place, as files do."""
        origin = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size}[whence]
        self._position = origin + offset
        return self._position

    def tell(self) -> int:
        """Return the place where the next byte is read or written."""
        return self._position

    def read(self, size: int) -> bytes:
        """Return that many bytes, zeros past the end."""
        buffer = bytearray(size)
        self.readinto(buffer)
        return bytes(buffer)

    def readinto(self, buffer: bytearray | memoryview) -> int:
        """Fill the buffer: from the disk, then with what was kept because it could not be written."""
        view = memoryview(buffer).cast("B")
        found = os.pread(self._descriptor, len(view), self._position)
        view[:] = found + bytes(len(view) - len(found))
        for offset, data in self._kept:
            first = max(offset, self._position)
            last = min(offset + len(data), self._position + len(view))
            if first < last:
                view[first - self._position : last - self._position] = data[first - offset : last - offset]
        self._position += len(view)
        return len(view)

    def write(self, data: bytes | memoryview) -> int:
        """Write all of the data, or keep it; never raises."""
        view = memoryview(data).cast("B")
        if self.error is None:
            self._write_to_disk(view)
        if self.error is not None:
            self._kept.append((self._position, bytes(view)))
        self._position += len(view)
        self._size = max(self._size, self._position)
        return len(view)

    def _write_to_disk(self, view: memoryview) -> None:
        done = 0
        try:
            while done < len(view):
                done += os.pwrite(self._descriptor, view[done:], self._position + done)
        except OSError as error:
            self.error = error

    def truncate(self, size: int | None = None) -> int:
        """Set the size of the file; never raises."""
        self._size = self._position if size is None else size
        if self.error is None:
            try:
                os.ftruncate(self._descriptor, self._size)
            except OSError as error:
                self.error = error
        return self._size

    def flush(self) -> None:
        """Nothing is buffered here."""
