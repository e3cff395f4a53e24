"""The operator's socket under attack: nothing keeps a command out, and nobody holds it up."""

import asyncio
import json
import socket
import time
from collections.abc import AsyncIterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator import operator_socket
from wil_campaign.safety.guard.operator.operator_socket import (
    MOST_CLIENTS,
    MOST_WATCHERS,
    OperatorSocket,
)


class Controller:
    """Obeys all, and remembers it."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "one.sock"
        self.pointer = folder / "operator.json"
        self.obeyed: list[OperatorCommand] = []
        self.refused: list[str] = []
        self.clients: list[asyncio.StreamWriter] = []

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        reader, writer = await asyncio.open_unix_connection(self.path)
        self.clients.append(writer)
        return reader, writer

    async def close(self) -> None:
        for writer in self.clients:
            writer.close()
        await asyncio.gather(
            *(writer.wait_closed() for writer in self.clients), return_exceptions=True
        )

    def obey(self, command: OperatorCommand) -> str:
        self.obeyed.append(command)
        return "done"

    def serve(self) -> OperatorSocket:
        return OperatorSocket(
            path=self.path,
            obey=self.obey,
            status=lambda: {"vehicles": {"real": "x" * 400}},
            refused=self.refused.append,
            pointer=self.pointer,
        )


@pytest.fixture
async def controller(short_folder: Path) -> AsyncIterator[Controller]:
    controller = Controller(short_folder)
    async with controller.serve():
        yield controller
        await controller.close()


async def say(writer: asyncio.StreamWriter, command: str) -> None:
    writer.write(json.dumps({"command": command, "who": "anna"}).encode() + b"\n")
    await writer.drain()


async def ask(controller: Controller, command: str) -> tuple[dict[str, Any], asyncio.StreamWriter]:
    reader, writer = await controller.connect()
    await say(writer, command)
    async with asyncio.timeout(30.0):
        return json.loads(await reader.readline()), writer


async def test_watchers_keep_no_command_out(controller: Controller) -> None:
    watching = [await ask(controller, "watch") for _ in range(MOST_WATCHERS)]
    assert all(answer["ok"] for answer, _ in watching)
    more, _ = await ask(controller, "watch")
    assert (more["ok"], more["text"]) == (False, "16 watchers are connected already")
    answer, _ = await ask(controller, "abort")
    assert answer["ok"]
    assert [command.kind for command in controller.obeyed] == ["abort"]
    # The place of a watcher that goes is free again.
    watching[0][1].close()
    async with asyncio.timeout(30.0):
        while not (await ask(controller, "watch"))[0]["ok"]:  # noqa: ASYNC110 - a place sets no event
            await asyncio.sleep(0.05)


async def test_silent_connections_keep_no_command_out(controller: Controller) -> None:
    silent = [await controller.connect() for _ in range(MOST_CLIENTS + 20)]
    answer, _ = await ask(controller, "abort")
    assert answer["ok"]
    # Those that were silent longest made room, and nobody else.
    async with asyncio.timeout(30.0):
        assert await silent[0][0].read() == b""
    assert not silent[-1][0].at_eof()
    assert any("the oldest is closed" in text for text in controller.refused)
    assert len(controller.refused) <= 22


async def test_a_watcher_may_send_an_abort(controller: Controller) -> None:
    """Its commands after `watch` were never read."""
    reader, writer = await controller.connect()
    await say(writer, "watch")
    await say(writer, "abort")
    async with asyncio.timeout(30.0):
        commands = [json.loads(await reader.readline())["command"] for _ in range(3)]
    assert commands == ["watch", "abort", "watch"]
    assert [one.kind for one in controller.obeyed] == ["abort"]


async def test_a_watcher_that_does_not_read_is_dropped(
    controller: Controller, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(operator_socket, "_WATCH_S", 0.005)
    monkeypatch.setattr(operator_socket, "_READ_S", 0.1)
    deaf = socket.socket(socket.AF_UNIX)
    deaf.setblocking(False)
    await asyncio.get_running_loop().sock_connect(deaf, str(controller.path))
    await asyncio.get_running_loop().sock_sendall(deaf, b'{"command": "watch"}\n')
    reader, writer = await controller.connect()
    await say(writer, "watch")
    await reader.readline()
    before = len(asyncio.all_tasks())
    dropped_s = time.monotonic() + 60.0
    while time.monotonic() < dropped_s:
        async with asyncio.timeout(30.0):
            assert await reader.readline()
        deaf_is_gone = len(asyncio.all_tasks()) < before
        if deaf_is_gone:
            break
    assert deaf_is_gone
    deaf.close()


async def test_an_abort_is_obeyed_in_a_storm_of_connections(controller: Controller) -> None:
    """About a thousand connections a second that say nothing, and stay."""
    storm: list[asyncio.StreamWriter] = []
    over = asyncio.Event()

    async def blow() -> None:
        while not over.is_set():
            storm.extend([(await controller.connect())[1] for _ in range(10)])
            await asyncio.sleep(0.01)
            while len(storm) > 300:
                storm.pop(0).close()

    blowing = asyncio.create_task(blow())
    for _ in range(50):
        answer, writer = await ask(controller, "abort")
        assert answer["ok"]
        writer.close()
        await asyncio.sleep(0.005)
    over.set()
    await blowing
    assert len(controller.obeyed) == 50


async def test_the_pointer_follows_no_link(short_folder: Path, tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.write_text("mine")
    controller = Controller(short_folder)
    controller.pointer.symlink_to(precious)
    async with controller.serve():
        assert json.loads(controller.pointer.read_text())["socket"] == str(controller.path)
    assert precious.read_text() == "mine"


async def test_a_pointer_that_a_full_disk_refuses_leaves_nothing(
    short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The socket stayed and listened, beside an operator.json of no bytes."""

    def fill(path: Path, _: str) -> None:
        path.write_text("")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(operator_socket, "write_private", fill)
    controller = Controller(short_folder)
    with pytest.raises(OSError, match=r"No space left on device: '.*operator\.json'"):
        await controller.serve().__aenter__()
    assert not controller.path.exists()
    assert not controller.pointer.exists()


async def test_a_watcher_that_is_there_at_the_end_is_no_exception(short_folder: Path) -> None:
    """Its cancelled task was reported as an exception of ours, and the campaign ended with 3."""
    reported: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: reported.append(context))
    controller = Controller(short_folder)
    async with controller.serve():
        await ask(controller, "watch")
    await asyncio.sleep(0.01)
    await controller.close()
    assert reported == []


@pytest.mark.parametrize("turns", range(5))
def test_a_connection_in_the_moment_of_closing_is_closed(short_folder: Path, turns: int) -> None:
    path = short_folder / "campaign.sock"

    async def close_after() -> socket.socket:
        async with OperatorSocket(path=path, obey=lambda _: "", status=dict, refused=print):
            client = socket.socket(socket.AF_UNIX)
            client.connect(str(path))
            for _ in range(turns):
                await asyncio.sleep(0)
        return client

    with asyncio.run(close_after()) as client:
        client.settimeout(5.0)
        with suppress(ConnectionResetError):
            assert client.recv(1) == b""
