"""A disk that stands still until the event loop releases it."""

import asyncio
import os
import threading

import pytest

_HANGING_S = 20.0


class SlowDisk:
    """Every sync to the disk waits for `release`, which only a loop that runs can call."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._loop = asyncio.get_running_loop()
        self._reached = asyncio.Event()
        self._released = threading.Event()
        monkeypatch.setattr(os, "fsync", self._sync)

    async def reached(self) -> None:
        """Wait until something is to be synced, and the disk stands still."""
        await self._reached.wait()

    def release(self) -> None:
        """Let the disk take everything from now on."""
        self._released.set()

    def _sync(self, _handle: int) -> None:
        if asyncio._get_running_loop() is not None:
            raise AssertionError("the event loop waits for the disk")
        self._loop.call_soon_threadsafe(self._reached.set)
        assert self._released.wait(_HANGING_S), "nobody released the disk"


def end_threads(name: str) -> None:
    """Wait for the threads of a name, to which the disk was released."""
    for thread in threading.enumerate():
        if thread.name == name:
            thread.join(_HANGING_S)
