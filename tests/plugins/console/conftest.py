"""A console's server for tests, in this process, and a campaign that it commands."""

import asyncio
import json
import time
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from aiohttp import ClientResponse
from aiohttp.test_utils import TestClient, TestServer
from aiohttp.web import Application, Request

from tests.orchestrator.operator.controllers import FakeFleet, make_controller
from tests.ports import free_port
from wil_campaign.orchestrator.operator.operator_channels import open_operator_channels
from wil_campaign.orchestrator.operator.run_messages import RunProgressReport
from wil_campaign.plugins.console.console_access import ConsoleAccess, Role
from wil_campaign.plugins.console.console_address import ConsoleAddress, RequestRules
from wil_campaign.plugins.console.console_hub import ConsoleHub
from wil_campaign.plugins.console.console_server import ConsoleServer
from wil_campaign.plugins.console.flight_scope import FlightScope
from wil_campaign.plugins.console.page_commands import CommandSender

Client = TestClient[Request, Application]


class Console:
    """A console's server in this process, and a campaign that it commands."""

    def __init__(self, folder: Path, port: int) -> None:
        self.folder = folder
        self.fleet = FakeFleet()
        self.access = ConsoleAccess()
        self.hub = ConsoleHub(about={"mode": "live"}, access=self.access)
        self.sender = CommandSender(FlightScope())
        self.origin = f"http://127.0.0.1:{port}"
        self.pages = server = ConsoleServer(
            access=self.access,
            rules=RequestRules.of(ConsoleAddress("127.0.0.1", port), tls=False),
            hub=self.hub,
            sender=self.sender,
            cookie="session",
            time=asyncio.get_running_loop().time,
        )
        self.server = TestServer(server.application(), port=port)
        self.clients: list[Client] = []

    async def client(self, role: Role | None = None, name: str = "anna") -> Client:
        """Return a browser, with a session of this role."""
        client: Client = TestClient(self.server)
        self.clients.append(client)
        await client.start_server()
        if role is not None:
            done = await self.post(
                client, "/session", {"token": self.access.invite(role), "name": name}
            )
            assert done.status == 200
        return client

    def link(self, role: Role) -> str:
        """Return a link that a browser may join by, once."""
        return f"{self.origin}/#{self.access.invite(role)}"

    async def post(self, client: Client, path: str, body: object, **headers: str) -> ClientResponse:
        if isinstance(body, dict) and path == "/command":
            body = {
                "seen_s": time.monotonic(),
                **body,
            }  # as the page that has just been sent a status
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        sent = {"Origin": self.origin, "Content-Type": "application/json", **headers}
        return await client.post(path, data=data, headers=sent)

    def commands(self) -> list[tuple[str, str]]:
        """Return what reached the campaign, and by whom."""
        return [(one.kind, one.who) for one in (*self.fleet.told, *self.fleet.aborted)]

    def records(self) -> list[dict[str, object]]:
        path = self.folder / "operator.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


@pytest.fixture
async def console(
    tmp_path: Path, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[Console]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    made = Console(tmp_path, free_port())
    controller = make_controller(tmp_path, made.fleet)
    controller.news(RunProgressReport("large", "wil", 1, "goal", 12.0, verdict_so_far="PASS"))
    async with open_operator_channels(controller):
        await made.server.start_server()
        yield made
        for client in made.clients:
            await client.close()
        await made.server.close()
        made.sender.close()
