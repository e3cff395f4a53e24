"""Plays a recorded file of a sensor: it is read in a thread, and closed when that has ended."""

import asyncio
from collections.abc import Callable
from typing import Any, Generic, Literal, Protocol, Self, TypeVar

T = TypeVar("T")


class PlayedFile(Protocol):
    """Reads a recording (protocol); blocking; used by one thread at a time."""

    @property
    def name(self) -> str:
        """Return the file's name in messages."""

    def open(self) -> None:
        """Open the file. Raises SourceError."""

    def close(self) -> None:
        """Close the file; called once, also after a failed `open`."""


File = TypeVar("File", bound=PlayedFile)


class FilePlayer(Generic[File]):
    """The base of what plays a recorded file."""

    kind: Literal["file"] = "file"

    def __init__(self, file: File) -> None:
        self._file = file
        self._file_job: asyncio.Future[Any] | None = None

    async def __aexit__(self, *_: object) -> None:
        """Close the file."""
        await self._close()

    def __aiter__(self) -> Self:
        """Return the player itself."""
        return self

    async def _in_thread(self, job: Callable[[], T]) -> T:
        self._file_job = job_future = asyncio.get_running_loop().run_in_executor(None, job)
        return await asyncio.shield(job_future)

    async def _close(self) -> None:
        # The reader may have been cancelled while its thread still works on the file.
        if self._file_job is not None and not self._file_job.done():
            await asyncio.wait({self._file_job})
        self._file.close()
