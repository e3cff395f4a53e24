"""The guard has vehicles forked by the server that its orchestrator inherited, and watches them."""

import os
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import psutil
import pytest

from tests.safety.guard.remote_rigs import guard_config
from wil_campaign.foundation.processes import fork_server
from wil_campaign.foundation.processes.child import ChildProcess
from wil_campaign.foundation.processes.fork_server import ForkServer
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.vehicles import vehicle_server_process
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings
from wil_campaign.vehicles.vehicle_server_process import (
    VehicleServerProcess,
    inherit_vehicle_server,
    vehicle_program,
)


@asynccontextmanager
async def serving(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[int]:
    """Yield the id of a fork server that is ready: it has forked one process.

    No fixture: pytest changes the environment between them and a test.
    """
    monkeypatch.setattr(fork_server, "READY_S", 120.0)
    monkeypatch.setattr(vehicle_server_process, "_inherited", [])
    process = VehicleServerProcess()
    process.start()
    client = ForkServer(os.dup(process.descriptor), vehicle_program())
    first = ChildProcess(argv=(*vehicle_program(), "no settings"))
    await first.start_by(client)
    await first.end()
    client.close()
    assert process._child is not None
    assert process._child.pid is not None
    inherit_vehicle_server(process.descriptor)
    yield process._child.pid
    await process.close()


async def test_a_guards_vehicle_is_forked_and_ended_by_the_guard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = ProcessSettings(
        autopilot="px4", link="udpout://127.0.0.1:9", seed=1, end_with_parent=False
    )
    async with (
        serving(monkeypatch) as server,
        RemoteGuard(guard_config=guard_config(tmp_path)) as guard,
    ):
        pid = await guard.start("real", (*vehicle_program(), settings.model_dump_json()))
        assert psutil.Process(pid).ppid() == server
        assert await guard.start("twin", (*vehicle_program(), "no settings"))
        assert await guard.end_of("twin") == 2
    with suppress(psutil.NoSuchProcess):
        assert psutil.Process(pid).status() == psutil.STATUS_ZOMBIE


async def test_a_vehicle_is_started_where_the_server_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    theirs.close()
    with ours:
        monkeypatch.setattr(vehicle_server_process, "_inherited", [ours.fileno()])
        async with RemoteGuard(guard_config=guard_config(tmp_path)) as guard:
            pid = await guard.start("real", (*vehicle_program(), "no settings"))
            assert await guard.end_of("real") == 2
            assert pid
