"""An embedded vehicle in a process of its own, without a guard between."""

import asyncio
import os
import sys
from typing import Self

from wil_campaign.foundation.processes.child import ChildProcess, exit_status_text
from wil_campaign.foundation.processes.feed_socket import feed_environment, feed_pair
from wil_campaign.vehicles.embedded.emulations import load_kernels
from wil_campaign.vehicles.embedded.process.embedded_launch import FeedClient
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings
from wil_campaign.vehicles.links.link import LinkError

_FIRST_WORD_S = 90.0


class EmbeddedProcess:
    """A vehicle that ends with its context, or with us, however."""

    def __init__(self, *, settings: ProcessSettings) -> None:
        self._settings = settings
        self._child: ChildProcess | None = None
        self._stdin, self._hold = os.pipe()
        ours, self._theirs = feed_pair()
        self.feed = FeedClient(source=settings.source, end=ours)

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
        settings = self._settings.model_copy(update={"end_with_stdin": True})
        descriptor = self._theirs.fileno()
        self._child = child = ChildProcess(
            argv=(
                sys.executable,
                "-m",
                "wil_campaign.vehicles.embedded",
                settings.model_dump_json(),
            ),
            stdin=self._stdin,
            environment={**os.environ, **feed_environment(descriptor)},
            inherited=(descriptor,),
        )
        child.start(lambda _: self.feed.connected.set())
        self._theirs.close()
        try:
            async with asyncio.timeout(_FIRST_WORD_S):
                await self.feed.connected.wait()
            if not child.running:
                how = f"{exit_status_text(child.exit_code)}: {child.stderr_tail}"
                raise LinkError(f"it did not start, it {how}")  # noqa: TRY301
        except BaseException:
            await self.__aexit__(None, None, None)
            raise
        return self

    async def __aexit__(self, *raised: object) -> None:
        if self._child is not None:
            await self._child.end()
        for end in (self._stdin, self._hold):
            os.close(end)
        await self.feed.__aexit__(*raised)
