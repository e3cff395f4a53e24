"""The operator's Unix socket: for its owner only, and for as long as its process lives."""

import asyncio
import contextlib
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from safety.guard.core.operator_command import OperatorCommand
from safety.guard.operator.operator_lines import (
    LONGEST_LINE_BYTES,
    Query,
    RefusedLineError,
    answer,
    parse_line,
)
from vehicles.processes.linux import UnsupportedSystemError, peer_uid

POINTER = "operator.json"
"""The file in a results folder that says where the socket is: its own path may be too long."""
_WATCH_S = 0.5
_MOST_CLIENTS = 16
_IDLE_S = 60.0

Obey = Callable[[OperatorCommand], str]
"""Does what abort, hold or resume says and returns what was done, for the answer."""


class OperatorSocket:
    """The operator's socket, listening at `path`; an async context manager.

    obey: called with abort, hold and resume; may raise RefusedLineError. status: what `status` and
    `watch` are told. refused: called with the reason of what was no command at all. pointer:
    where to write where the socket is. Raises OSError when the socket cannot be had.
    """

    def __init__(
        self,
        *,
        path: Path,
        obey: Obey,
        status: Callable[[], Mapping[str, Any]],
        refused: Callable[[str], None],
        token: str = "",
        pointer: Path | None = None,
    ) -> None:
        self._path = path
        self._obey = obey
        self._status = status
        self._refused = refused
        self._token = token
        self._pointer = pointer
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> Self:
        """Listen on the operator's socket."""
        before = os.umask(0o177)
        try:
            self._server = await asyncio.start_unix_server(
                self._serve, path=self._path, limit=LONGEST_LINE_BYTES
            )
        finally:
            os.umask(before)
        if self._pointer is not None:
            said = {"socket": str(self._path), "pid": os.getpid()}
            self._pointer.write_text(json.dumps(said) + "\n", encoding="utf-8")
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop listening, and remove the operator's socket and its pointer."""
        if self._server is not None:
            self._server.close()
        clients = list(self._clients)
        for client in clients:
            client.cancel()
        await asyncio.gather(*clients, return_exceptions=True)
        self._path.unlink(missing_ok=True)
        if self._pointer is not None:
            with contextlib.suppress(OSError):
                self._pointer.unlink(missing_ok=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if task is not None:
            self._clients.add(task)
        try:
            if len(self._clients) > _MOST_CLIENTS or not _is_ours(writer):
                self._refused(
                    "connection refused: it belongs to another user, or 16 clients "
                    "are connected already"
                )
                return
            await self._converse(reader, writer)
        except (ConnectionError, TimeoutError):
            return
        finally:
            writer.close()
            if task is not None:
                self._clients.discard(task)

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while True:
            try:
                async with asyncio.timeout(_IDLE_S):
                    line = await reader.readline()
            except ValueError:
                self._refused("a line is too long")
                writer.write(answer(ok=False, text=f"longer than {LONGEST_LINE_BYTES} bytes"))
                return
            if not line:
                return
            asked = self._take(line, writer)
            await writer.drain()
            if asked == "watch":
                await self._watch(writer)

    def _take(self, line: bytes, writer: asyncio.StreamWriter) -> OperatorCommand | Query | None:
        try:
            asked = parse_line(line, token=self._token)
        except RefusedLineError as error:
            self._refused(str(error))
            writer.write(answer(ok=False, text=str(error)))
            return None
        name = asked.kind if isinstance(asked, OperatorCommand) else asked
        try:
            text = self._obey(asked) if isinstance(asked, OperatorCommand) else "as asked"
        except RefusedLineError as error:
            writer.write(answer(ok=False, text=str(error), command=name))
            return None
        writer.write(answer(ok=True, text=text, command=name, **self._status()))
        return asked

    async def _watch(self, writer: asyncio.StreamWriter) -> None:
        while not writer.is_closing():
            await asyncio.sleep(_WATCH_S)
            writer.write(answer(ok=True, text="", command="watch", **self._status()))
            await writer.drain()


def _is_ours(writer: asyncio.StreamWriter) -> bool:
    """Return whether the socket's peer is of the same user, by the kernel (SO_PEERCRED)."""
    try:
        uid = peer_uid(writer.get_extra_info("socket"))
    except UnsupportedSystemError:
        return True  # The socket's mode has to do.
    return uid in {os.getuid(), 0}
