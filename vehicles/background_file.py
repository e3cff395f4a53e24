"""A file that a thread of its own writes: a disk that stands still holds up nobody else.

Memory cards, network folders and busy disks take nothing for seconds now and then. Whoever flies
or guards a vehicle must not wait for them.
"""

import errno
import os
import threading
from pathlib import Path
from queue import SimpleQueue

_HANDED_OVER_BYTES = 1 << 16
"""What is buffered at most before the thread gets it."""
_MOST_BEHIND_BYTES = 64 << 20
_CLOSED_WITHIN_S = 30.0


class BackgroundFile:
    """A binary file that a thread of its own writes, in order.

    path: a new file; append: or one that is there. waits: at 64 MiB that the disk has not taken
    yet, a call waits for it; otherwise the file ends there with an error. What the disk refuses is
    raised by a later call, at the latest by `close`, and the file ends there. Raises OSError where
    the file cannot be opened.
    """

    def __init__(self, path: Path, *, append: bool = False, waits: bool = True) -> None:
        self.closed = False
        self._file = path.open("ab" if append else "xb", buffering=0)
        self._waits = waits
        self._buffer: list[bytes] = []
        self._buffered_bytes = 0
        self._queue: SimpleQueue[bytes | None] = SimpleQueue()
        self._taken = threading.Condition()
        self._behind_bytes = 0
        self._error: Exception | None = None
        # A daemon: a process that ends without closing must not wait for a disk.
        self._thread = threading.Thread(target=self._work, name=f"writer {path.name}", daemon=True)
        self._thread.start()

    @property
    def is_removed(self) -> bool:
        """Return whether the file was removed: writing to it is lost without an error."""
        return not self.closed and os.fstat(self._file.fileno()).st_nlink == 0

    def write(self, data: bytes) -> int:
        """Append data; the thread gets it with `flush`, or when much is buffered."""
        self._buffer.append(bytes(data))
        self._buffered_bytes += len(data)
        if self._buffered_bytes >= _HANDED_OVER_BYTES:
            self.flush()
        return len(data)

    def flush(self, within_s: float = 0.0) -> None:
        """Have the thread write what is buffered, and wait until it has, for at most within_s."""
        data = b"".join(self._buffer)
        self._buffer.clear()
        self._buffered_bytes = 0
        if data and self._error is None:
            self._give(data)
        if within_s > 0.0:
            with self._taken:
                self._taken.wait_for(lambda: not self._behind_bytes, within_s)
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """Write all and close the file; may be called more than once.

        Raises what the disk refused, and TimeoutError where it takes nothing for 30 s.
        """
        if self.closed:
            return
        try:
            self.flush()
        finally:
            self.closed = True
            self._queue.put(None)
            self._thread.join(_CLOSED_WITHIN_S)
        if self._error is not None:
            raise self._error
        if self._thread.is_alive():
            text = f"the disk takes nothing, {self._backlog()} are lost"
            raise TimeoutError(errno.ETIMEDOUT, text)

    def _give(self, data: bytes) -> None:
        with self._taken:
            if self._behind_bytes + len(data) > _MOST_BEHIND_BYTES:
                if not self._waits:
                    text = f"the disk takes nothing, and {self._backlog()} wait for it"
                    self._error = OSError(errno.ENOBUFS, text)
                    return
                self._taken.wait_for(lambda: not self._behind_bytes)
            self._behind_bytes += len(data)
        self._queue.put(data)

    def _backlog(self) -> str:
        return f"{self._behind_bytes / 1e6:.1f} MB"

    def _work(self) -> None:
        """Write what was given until the end, or until the disk refuses it (in the thread)."""
        is_refused = False
        while (data := self._queue.get()) is not None:
            is_refused = is_refused or not self._put(data)
            with self._taken:
                self._behind_bytes -= len(data)
                self._taken.notify_all()
        try:
            self._file.close()
        except OSError as error:
            self._error = self._error or error

    def _put(self, data: bytes) -> bool:
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except Exception as error:  # noqa: BLE001  # whoever writes next raises it
            self._error = error
            return False
        return True
