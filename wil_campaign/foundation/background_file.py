"""A file that a thread of its own writes: a disk that stands still holds up nobody else.

Memory cards, network folders and busy disks take nothing for seconds now and then. Whoever flies
or guards a vehicle must not wait for them.
"""

import errno
import os
import threading
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue

_HANDED_OVER_BYTES = 1 << 16
"""What is buffered at most before the thread gets it."""
_MOST_BEHIND_BYTES = 64 << 20
_POLL_S = 0.05
_MOST_POLLS = 240
"""Of our own turns, not of time: a process that was stopped must not take a good disk for a dead
one. 12 s for a disk that takes nothing, and in all for a guard's end: others wait 15 s for that."""
_MOST_POLLS_IN_ALL = 800
"""40 s for a slow disk at the end of a run: others wait 60 s for it."""
_LEAST_POLLS = 10
_KEPT_POLLS = 40
"""Of those in all: what slow files leave to later ones, for their least polls."""


class DiskPatience:
    """How long the ends of all files of a process together wait for the disk.

    So long as it takes something, they wait on, but not for more than so many polls in all.
    """

    def __init__(self) -> None:
        self._polls = 0
        self._polls_in_all = 0

    def begin(self) -> None:
        """Begin anew, also with the polls in all: what is opened now is of a later run."""
        self._polls = self._polls_in_all = 0

    def renew(self) -> None:
        """Begin anew to wait for a disk that takes nothing: it has taken something."""
        self._polls = 0

    def waits_on(self, polls: int, *, is_brief: bool = False) -> bool:
        """Return whether an end that has polled so often waits for a further one.

        is_brief: of a guard, for whose end others do not wait as long as for that of a run.
        """
        self._polls += 1
        self._polls_in_all += 1
        left = (_MOST_POLLS if is_brief else _MOST_POLLS_IN_ALL) - self._polls_in_all
        if polls < _LEAST_POLLS:
            return left >= 0
        return self._polls <= _MOST_POLLS and left >= _KEPT_POLLS


patience = DiskPatience()
"""Of this process."""


class BackgroundFile:
    """A binary file that a thread of its own writes, in order; used by one other thread.

    path: a new file; append: or one that is there. waits: at 64 MiB that the disk has not taken
    yet, `write` waits for it; otherwise the file ends there with an error, and its end waits for
    a slow disk no longer than for a dead one. begin: called first in the thread, as to give it a
    priority. What the disk refuses is raised by a later `flush`, and by `close`; the file ends
    there. Raises OSError where the file cannot be opened.
    """

    def __init__(
        self,
        path: Path,
        *,
        append: bool = False,
        waits: bool = True,
        begin: Callable[[], object] | None = None,
    ) -> None:
        self.closed = False
        self.is_removed = False
        """Whether another file or none was in its place by the last write: it was removed, or moved
        with its folder. Then it is lost without an error."""
        self._file = path.open("ab" if append else "xb", buffering=0)
        self._path = path.absolute()
        self._waits = waits
        self._patience = patience
        self._patience.begin()
        self._begin = begin
        self._buffer: list[bytes] = []
        self._buffered_bytes = 0
        self._queue: SimpleQueue[bytes | None] = SimpleQueue()
        self._taken = threading.Condition()
        self._behind_bytes = 0
        self._is_late = False
        self._error: Exception | None = None
        # A daemon: a process that ends without closing must not wait for a disk.
        self._thread = threading.Thread(target=self._work, name=f"writer {path.name}", daemon=True)
        self._thread.start()

    def write(self, data: bytes) -> int:
        """Append data; the thread gets it with `flush`, or when much is buffered.

        Raises ValueError once the file is closed.
        """
        if self.closed:
            raise ValueError(f"{self._path.name} is closed")
        self._buffer.append(bytes(data))
        self._buffered_bytes += len(data)
        if self._buffered_bytes >= _HANDED_OVER_BYTES:
            self._hand_over(_MOST_BEHIND_BYTES)
        return len(data)

    def flush(self, within_s: float = 0.0) -> None:
        """Have the thread write what is buffered, and wait until it has, for at most within_s.

        Once it took longer, there is no more waiting until the thread has caught up. Raises what
        the disk refused.
        """
        self._hand_over(_MOST_BEHIND_BYTES)
        if within_s > 0.0:
            with self._taken:
                if not self._is_late:
                    self._is_late = not self._taken.wait_for(self._has_caught_up, within_s)
        self._raise_error()

    def close(self) -> None:
        """Write all and close the file; may be called more than once.

        Raises what the disk refused, and TimeoutError where it takes nothing for 12 s, or not all
        within what the ends of all files of this process wait for it.
        """
        if self.closed:
            return
        self._hand_over(None)
        self.closed = True
        self._queue.put(None)
        behind_bytes, polls = self._behind_bytes, 0
        # Once before it asks: where others have used up all patience, a good disk is not dead.
        self._thread.join(_POLL_S)
        while self._thread.is_alive() and self._patience.waits_on(polls, is_brief=not self._waits):
            self._thread.join(_POLL_S)
            polls += 1
        self._raise_error()
        if self._thread.is_alive():
            much = "too little" if self._behind_bytes < behind_bytes else "nothing"
            text = f"the disk takes {much}, {self._backlog()} are lost"
            raise TimeoutError(errno.ETIMEDOUT, text)

    def _hand_over(self, most_bytes: int | None) -> None:
        data = b"".join(self._buffer)
        self._buffer.clear()
        self._buffered_bytes = 0
        if not data or self._error is not None:
            return
        with self._taken:
            if most_bytes is not None and self._behind_bytes + len(data) > most_bytes:
                if not self._waits:
                    text = f"the disk takes nothing, and {self._backlog()} wait for it"
                    self._error = OSError(errno.ENOBUFS, text)
                    return
                self._taken.wait_for(self._has_caught_up)
            self._behind_bytes += len(data)
        self._queue.put(data)

    def _has_caught_up(self) -> bool:
        return not self._behind_bytes

    def _backlog(self) -> str:
        return f"{self._behind_bytes / 1e6:.1f} MB"

    def _raise_error(self) -> None:
        if self._error is not None:
            # Raised often, it would hold on to each caller's frames.
            raise self._error.with_traceback(None)

    def _work(self) -> None:
        """Write what was given until the end, or until the disk refuses it (in the thread)."""
        if self._begin is not None:
            self._begin()
        is_refused = False
        while (data := self._queue.get()) is not None:
            is_refused = is_refused or not self._put(data)
            self._patience.renew()
            with self._taken:
                self._behind_bytes -= len(data)
                self._is_late = self._is_late and self._behind_bytes > 0
                self._taken.notify_all()
        try:
            with self._file:
                self._look()
        except Exception as error:  # noqa: BLE001  # `close` raises it
            self._error = self._error or error
        self._patience.renew()

    def _put(self, data: bytes) -> bool:
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
            self._look()
        except Exception as error:  # noqa: BLE001  # whoever writes next raises it
            self._error = error
            return False
        return True

    def _look(self) -> None:
        # Here, because a network folder may take as long for it as for a write.
        own = os.fstat(self._file.fileno())
        try:
            self.is_removed = not os.path.samestat(own, self._path.stat())
        except (FileNotFoundError, NotADirectoryError):
            self.is_removed = True
