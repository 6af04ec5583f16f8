"""Reading ahead: another thread advances an iterator while its items are being used."""

from collections.abc import Generator, Iterator
from queue import Empty, Queue
from threading import Event, Thread
from typing import Generic, TypeVar

T = TypeVar("T")

DEPTH = 1
"""Items that may wait: one is ready while the next is being made. More would only fill the memory."""


def read_ahead(items: Iterator[T], depth: int = DEPTH) -> Generator[T, None, None]:
    """Yield the items of an iterator, in order, while a thread of its own makes the next ones.

    At most `depth` items wait, so that a fast iterator does not fill the memory. What it raises is raised here, after
    the items before. When this generator is closed, the thread has ended.
    """
    ahead = _Ahead(items, depth)
    try:
        yield from ahead.taken()
    finally:
        ahead.stop()


class _Ahead(Generic[T]):
    def __init__(self, items: Iterator[T], depth: int) -> None:
        self._items = items
        self._queue: Queue[tuple[T] | BaseException | None] = Queue(depth)
        self._stopped = Event()
        self._thread = Thread(target=self._advance, name="mdtopo-reader", daemon=True)
        self._thread.start()

    def _advance(self) -> None:
        try:
            for item in self._items:
                self._queue.put((item,))
                if self._stopped.is_set():
                    return
            self._queue.put(None)
        except BaseException as error:  # whatever it is, the consumer is to see it
            self._queue.put(error)

    def taken(self) -> Iterator[T]:
        """Yield the items in order; an error of the reading thread is raised here."""
        while (item := self._queue.get()) is not None:
            if isinstance(item, BaseException):
                raise item
            yield item[0]

    def stop(self) -> None:
        """Let the reading thread end, and wait until it has."""
        self._stopped.set()
        while self._thread.is_alive():  # it may be waiting for room
            try:
                self._queue.get(timeout=0.02)
            except Empty:
                continue
        self._thread.join()
