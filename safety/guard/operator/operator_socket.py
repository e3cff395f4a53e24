"""The operator's Unix socket: for its owner only, open as long as its process lives.

Other clients cannot keep a command out: a new client replaces the one that was silent longest,
watchers are counted separately, and a client that does not read its answers is dropped.
"""

import asyncio
import contextlib
import json
import os
import socket
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

from wil_campaign.foundation.processes.linux import UnsupportedSystemError, socket_peer_uid
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_lines import (
    LONGEST_LINE_BYTES,
    Query,
    RefusedLineError,
    answer_line,
    parse_line,
)
from wil_campaign.safety.guard.operator.rate_limit import RateLimit

POINTER = "operator.json"
"""The file in a results folder with the socket's path; the folder's own may be too long for one."""
MOST_WATCHERS = 16
MOST_CLIENTS = 256
"""Connections that are not watchers; a new one replaces the one that was silent longest."""
_BACKLOG = 64
"""Connections accepted in one turn of the loop: fewer than MOST_CLIENTS, so that each is read."""
_TURNS_TO_ACCEPT = 4
"""Turns of the loop from an accepted connection to the task that serves it: 3."""
_WATCH_S = 0.5
_WATCHER_BUFFER_BYTES = 8192
_IDLE_S = 10.0
_READ_S = 1.0
"""How long a client may leave answers unread."""
_MOST_REFUSALS_A_SECOND = 10

Obey = Callable[[OperatorCommand], str]
"""Executes an abort, hold or resume; returns the text of the answer."""

_Client = asyncio.Task[None]


class OperatorSocket:
    """The operator's socket, listening at `path`; an async context manager.

    obey: called with each command; may raise RefusedLineError. status: returns the status for
    `status` and `watch`. refused: called with the reason of each line that is no command. pointer:
    the file that gets the path of the socket. Raises OSError when the socket cannot be opened.
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
        self._report_refusal = refused
        self._token = token
        self._pointer = pointer
        self._server: asyncio.Server | None = None
        self._clients: OrderedDict[_Client, asyncio.StreamWriter] = OrderedDict()
        self._watchers: set[_Client] = set()
        self._refusals = RateLimit(most=_MOST_REFUSALS_A_SECOND)
        self._is_closing = False

    async def __aenter__(self) -> Self:
        """Listen on the operator's socket."""
        before = os.umask(0o177)
        try:
            self._server = await asyncio.start_unix_server(
                self._serve, path=self._path, limit=LONGEST_LINE_BYTES, backlog=_BACKLOG
            )
        finally:
            os.umask(before)
        if self._pointer is not None:
            message = {"socket": str(self._path), "pid": os.getpid()}
            try:
                write_private(self._pointer, json.dumps(message) + "\n")
            except OSError as error:
                await self.__aexit__()
                raise OSError(error.errno, error.strerror, str(self._pointer)) from error
        return self

    async def __aexit__(self, *_: object) -> None:
        """Stop listening, and remove the operator's socket and its pointer."""
        self._is_closing = True
        if self._server is not None:
            await _settle(self._server)
            self._server.close()
        clients = [*self._clients, *self._watchers]
        for client in clients:
            client.cancel()
        await asyncio.gather(*clients, return_exceptions=True)
        self._path.unlink(missing_ok=True)
        if self._pointer is not None:
            with contextlib.suppress(OSError):
                self._pointer.unlink(missing_ok=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if task is None:
            return
        try:
            if not _is_same_user(writer):
                self._refuse("connection refused: it belongs to another user")
                return
            self._admit(task, writer)
            await self._converse(task, reader, writer)
        except ConnectionError:
            return
        except TimeoutError:
            # A plain close waits until the client has read, which it does not.
            writer.transport.abort()
        except asyncio.CancelledError:
            # Python 3.11 reports a connection's cancelled task as an unhandled exception.
            if not self._is_closing:
                raise
        finally:
            writer.close()
            self._clients.pop(task, None)
            self._watchers.discard(task)

    def _admit(self, task: _Client, writer: asyncio.StreamWriter) -> None:
        """Add a connection; if there are too many, close the one that was silent longest.

        Commands that it has already sent are still executed.
        """
        self._clients[task] = writer
        if len(self._clients) > MOST_CLIENTS:
            _, oldest = self._clients.popitem(last=False)
            oldest.transport.abort()
            self._refuse(f"more than {MOST_CLIENTS} connections: the oldest is closed")

    async def _converse(
        self, task: _Client, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        while True:
            try:
                async with asyncio.timeout(_WATCH_S if task in self._watchers else _IDLE_S):
                    line = await reader.readline()
            except TimeoutError:
                if task not in self._watchers:
                    raise
                await self._send_status(writer)
                continue
            except ValueError:
                self._refuse("a line is too long")
                writer.write(
                    answer_line(
                        ok=False, text=f"the line is longer than {LONGEST_LINE_BYTES} bytes"
                    )
                )
                return
            if not line and (task not in self._watchers or writer.is_closing()):
                return
            if not line:
                # It has closed its sending end, and may still read.
                await asyncio.sleep(_WATCH_S)
                await self._send_status(writer)
                continue
            if task in self._clients:
                self._clients.move_to_end(task)
            request = self._handle_line(line, writer)
            await _let_read(writer)
            if request == "watch":
                self._become_watcher(task, writer)

    def _refuse(self, text: str) -> None:
        if not self._refusals.is_exceeded(asyncio.get_running_loop().time()):
            self._report_refusal(text)  # Limited, so that a flood does not fill the disk.

    def _handle_line(
        self, line: bytes, writer: asyncio.StreamWriter
    ) -> OperatorCommand | Query | None:
        try:
            request = parse_line(line, token=self._token, now_s=time.monotonic())
        except RefusedLineError as error:
            self._refuse(str(error))
            writer.write(answer_line(ok=False, text=str(error)))
            return None
        name = request.kind if isinstance(request, OperatorCommand) else request
        if name == "watch" and len(self._watchers) >= MOST_WATCHERS:
            message = f"{MOST_WATCHERS} watchers are connected already"
            writer.write(answer_line(ok=False, text=message, command=name))
            return None
        try:
            text = self._obey(request) if isinstance(request, OperatorCommand) else "done"
        except RefusedLineError as error:
            writer.write(answer_line(ok=False, text=str(error), command=name))
            return None
        writer.write(answer_line(ok=True, text=text, command=name, **self._status()))
        return request

    def _become_watcher(self, task: _Client, writer: asyncio.StreamWriter) -> None:
        self._clients.pop(task, None)
        self._watchers.add(task)
        # With small buffers a client that does not read is detected within seconds.
        peer: socket.socket = writer.get_extra_info("socket")
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _WATCHER_BUFFER_BYTES)
        writer.transport.set_write_buffer_limits(high=0)

    async def _send_status(self, writer: asyncio.StreamWriter) -> None:
        """Send a watcher the status, and wait until it has read it. Raises TimeoutError."""
        writer.write(answer_line(ok=True, text="", command="watch", **self._status()))
        await _let_read(writer)


async def _let_read(writer: asyncio.StreamWriter) -> None:
    """Wait until a client has read its answers. Raises TimeoutError."""
    async with asyncio.timeout(_READ_S):
        await writer.drain()


def write_private(path: Path, text: str) -> None:
    """Write a file of mode 0600, replacing what is there; a symbolic link is not followed."""
    path.unlink(missing_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(text)


async def _settle(server: asyncio.Server) -> None:
    """Accept nothing more, and let connections that were just accepted come to their clients.

    A server that is closed between the two leaves them open (Python 3.11 to 3.13).
    """
    loop = asyncio.get_running_loop()
    for listening in server.sockets:
        loop.remove_reader(listening.fileno())
    for _ in range(_TURNS_TO_ACCEPT):
        await asyncio.sleep(0)


def _is_same_user(writer: asyncio.StreamWriter) -> bool:
    """Return whether the kernel says that the peer is the same user or root (SO_PEERCRED)."""
    try:
        uid = socket_peer_uid(writer.get_extra_info("socket"))
    except UnsupportedSystemError:
        return True  # The file mode of the socket is the protection then.
    return uid in {os.getuid(), 0}
