"""Programs of others fly the embedded vehicle: connect, parameters, fence, mission, goto, logs.

Each is a real process on a real socket; the vehicle's clock goes some times faster than the wall's,
so that none takes longer than it must.
"""

import asyncio
import os
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from vehicles.embedded.settings import ProcessSettings

HERE = Path(__file__).parent
ROOT = Path(__file__).parents[3]
SPEED = 8.0
WITHIN_S = 100.0


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@asynccontextmanager
async def vehicle(link: str, autopilot: str) -> AsyncIterator[None]:
    settings = ProcessSettings(autopilot=autopilot, link=link, seed=1, speed=SPEED)  # type: ignore[arg-type]  # one of the two
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "vehicles.embedded", settings.model_dump_json()),
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    try:
        yield
    finally:
        process.terminate()
        await process.wait()


async def flown_by(program: str, *arguments: str) -> str:
    """Run a client to its end and return what it said."""
    client = await asyncio.create_subprocess_exec(
        *(sys.executable, str(HERE / program), *arguments),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        async with asyncio.timeout(WITHIN_S):
            out, err = await client.communicate()
    except TimeoutError:
        client.kill()
        out, err = await client.communicate()
    assert client.returncode == 0, f"{out.decode()}\n{err.decode()}"
    return out.decode()


@pytest.mark.parametrize(
    ("autopilot", "over", "url"),
    [("px4", "udp", "udpin://127.0.0.1:{}"), ("ardupilot", "tcp", "tcpout://127.0.0.1:{}")],
)
async def test_mavsdk(autopilot: str, over: str, url: str) -> None:
    kind = socket.SOCK_DGRAM if over == "udp" else socket.SOCK_STREAM
    port = free_port(kind)
    link = f"udpout://127.0.0.1:{port}" if over == "udp" else f"tcpin://127.0.0.1:{port}"
    async with vehicle(link, autopilot):
        said = await flown_by("mavsdk_client.py", url.format(port), autopilot)
    assert "landed" in said
    assert "log of" in said


@pytest.mark.parametrize(
    ("autopilot", "over", "url"),
    [("px4", "tcp", "tcp:127.0.0.1:{}"), ("ardupilot", "udp", "udpin:127.0.0.1:{}")],
)
async def test_scripts_with_pymavlink(autopilot: str, over: str, url: str) -> None:
    kind = socket.SOCK_DGRAM if over == "udp" else socket.SOCK_STREAM
    port = free_port(kind)
    link = f"udpout://127.0.0.1:{port}" if over == "udp" else f"tcpin://127.0.0.1:{port}"
    async with vehicle(link, autopilot):
        said = await flown_by("pymavlink_client.py", url.format(port), autopilot)
    assert "landed" in said
    assert "logs 1" in said


async def test_mavproxy(tmp_path: Path) -> None:
    port = free_port(socket.SOCK_STREAM)
    async with vehicle(f"tcpin://127.0.0.1:{port}", "ardupilot"):
        said = await flown_by(
            "mavproxy_client.py", f"tcp:127.0.0.1:{port}", "ardupilot", str(tmp_path)
        )
    assert "landed" in said
