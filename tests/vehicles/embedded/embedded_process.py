"""An embedded vehicle in a process of its own, without a guard between."""

import asyncio
import os
import sys
from types import TracebackType
from typing import Self

from vehicles.embedded.control.law import load_kernels
from vehicles.embedded.process.embedded_launch import FeedClient
from vehicles.embedded.process.process_settings import ProcessSettings
from vehicles.links.link import LinkError
from vehicles.processes.child import ChildProcess, how_it_ended

_FIRST_WORD_S = 90.0


class EmbeddedProcess:
    """A vehicle that ends with its context, or with us, however."""

    def __init__(self, *, settings: ProcessSettings) -> None:
        self._settings = settings
        self._child: ChildProcess | None = None
        self._stdin, self._hold = os.pipe()
        self.feed = FeedClient(source=settings.source, port=settings.feed_port)

    @property
    def pid(self) -> int | None:
        return None if self._child is None else self._child.pid

    @property
    def exit_code(self) -> int | None:
        return None if self._child is None else self._child.exit_code

    @property
    def stderr_tail(self) -> str:
        return "" if self._child is None else self._child.stderr_tail.rstrip()

    async def __aenter__(self) -> Self:
        load_kernels()  # as a run does before it launches vehicles
        await self.feed.__aenter__()
        settings = self._settings.model_copy(
            update={"feed_port": self.feed.port, "end_with_stdin": True}
        )
        self._child = child = ChildProcess(
            argv=(sys.executable, "-m", "vehicles.embedded", settings.model_dump_json()),
            stdin=self._stdin,
        )
        child.start(lambda _: self.feed.connected.set())
        try:
            async with asyncio.timeout(_FIRST_WORD_S):
                await self.feed.connected.wait()
            if not child.running:
                how = f"{how_it_ended(child.exit_code)}: {child.stderr_tail}"
                raise LinkError(f"it did not start, it {how}")  # noqa: TRY301
        except BaseException:
            await self.__aexit__(None, None, None)
            raise
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._child is not None:
            await self._child.end()
        for end in (self._stdin, self._hold):
            os.close(end)
        await self.feed.__aexit__(kind, error, trace)
