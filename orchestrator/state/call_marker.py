"""Marks that the autonomy is being called, for a process that dies in the call or hangs in it.

The process of a run has the autonomy's code in it, and ours: whose fault its end is, only a mark
that outlives it can tell. It is shared memory without a file: no disk can delay or fail it.
"""

import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager

from wil_campaign.foundation.processes.linux import memory_descriptor

_NAME_BYTES = 16
_BYTES = _NAME_BYTES + 1
_mark = mmap.mmap(-1, _BYTES)
"""The mark of this process; of a worker the one that its parent reads."""


class CallMark:
    """The parent's end of a worker's mark.

    descriptor: for the worker, which adopts it; to be closed here once it is sent.
    """

    def __init__(self) -> None:
        self.descriptor = memory_descriptor("wil-campaign call")
        os.ftruncate(self.descriptor, _BYTES)
        self._mark = mmap.mmap(self.descriptor, _BYTES)

    @property
    def vehicle(self) -> str:
        """Return the vehicle whose autonomy is being called, or was at the end; "" for none."""
        return self._mark[:_NAME_BYTES].rstrip(b"\0").decode("utf-8", "replace")

    @property
    def has_goal(self) -> bool:
        """Return whether that call is one that only an autonomy with its goal gets."""
        return bool(self._mark[_NAME_BYTES])


def adopt_call_mark(descriptor: int) -> None:
    """Mark calls where the parent of this worker reads them. Closes the descriptor."""
    global _mark  # noqa: PLW0603 - of the process, as its signal handlers are
    _mark = mmap.mmap(descriptor, _BYTES)
    os.close(descriptor)


@contextmanager
def marked_autonomy_call(vehicle: str, *, has_goal: bool = False) -> Iterator[None]:
    """Mark that the autonomy of a vehicle is called within the context.

    has_goal: the call is one that only an autonomy with its goal gets.
    """
    _mark[:] = vehicle.encode()[:_NAME_BYTES].ljust(_NAME_BYTES, b"\0") + bytes([has_goal])
    try:
        yield
    finally:
        _mark[:] = bytes(_BYTES)
