"""Programs of others fly the embedded vehicle: connect, parameters, fence, mission, goto, logs.

Each is a real process on a real socket; the vehicle's clock goes some times faster than the wall's,
so that none takes longer than it must.
"""

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.ports import free_port
from tests.vehicles.embedded.running_vehicle import running_vehicle
from wil_campaign import mock_vehicle
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings

HERE = Path(__file__).parent
ROOT = Path(__file__).parents[3]
SPEED = 8.0
WITHIN_S = 100.0


@asynccontextmanager
async def vehicle(link: str, autopilot: str) -> AsyncIterator[None]:
    settings = ProcessSettings(
        autopilot=autopilot,
        link=link,
        seed=1,
        speed=SPEED,
        running_s=30.0,  # ArduCopter boots for 40 s
        # Else it disarms on the ground 10 s after it was armed: by the wall, in 1.25 s.
        parameters={"COM_DISARM_PRFLT" if autopilot == "px4" else "DISARM_DELAY": 60.0},
    )
    async with running_vehicle(settings):
        yield


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


NORTH_M = 11.1
"""Where the clients fly: 1e-4 degrees of latitude north."""
_WITNESSED = (32, 245)
"""LOCAL_POSITION_NED and EXTENDED_SYS_STATE."""


def witness(url: str) -> dict[str, Any]:
    """Listen to the vehicle by itself, once the client is gone; return its latest messages."""
    link = mavutil.mavlink_connection(url, source_system=254, dialect="ardupilotmega")
    try:
        seen: dict[str, Any] = {}
        for count in range(20_000):
            if count % 500 == 0:
                link.mav.heartbeat_send(6, 8, 0, 0, 0)
                for number in _WITNESSED:
                    link.mav.command_long_send(1, 1, 511, 0, number, 100_000, 0, 0, 0, 0, 0)
            message = link.recv_match(blocking=True, timeout=0.5)
            if message is not None and message.get_srcComponent() == 1:
                seen[message.get_type()] = message
            if {"HEARTBEAT", "LOCAL_POSITION_NED", "EXTENDED_SYS_STATE"} <= seen.keys():
                break
        return seen
    finally:
        link.close()


async def is_down_in_the_north(url: str) -> None:
    """Require, of the vehicle itself, that it flew north and stands there disarmed."""
    seen = await asyncio.to_thread(witness, url)
    assert not seen["HEARTBEAT"].base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    assert seen["EXTENDED_SYS_STATE"].landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
    assert seen["LOCAL_POSITION_NED"].x == pytest.approx(NORTH_M, abs=2.0)


@pytest.mark.parametrize(
    ("autopilot", "over", "url"),
    [("px4", "udp", "udpin://127.0.0.1:{}"), ("ardupilot", "tcp", "tcpout://127.0.0.1:{}")],
)
async def test_mavsdk_flies_the_embedded_vehicle(autopilot: str, over: str, url: str) -> None:
    port = free_port()
    link = f"udpout://127.0.0.1:{port}" if over == "udp" else f"tcpin://127.0.0.1:{port}"
    async with vehicle(link, autopilot):
        said = await flown_by("mavsdk_client.py", url.format(port), autopilot)
        await is_down_in_the_north(f"{'udpin' if over == 'udp' else 'tcp'}:127.0.0.1:{port}")
    assert "log of" in said


@pytest.mark.parametrize(
    ("autopilot", "over", "url"),
    [("px4", "tcp", "tcp:127.0.0.1:{}"), ("ardupilot", "udp", "udpin:127.0.0.1:{}")],
)
async def test_scripts_with_pymavlink_fly_the_embedded_vehicle(
    autopilot: str, over: str, url: str
) -> None:
    port = free_port()
    link = f"udpout://127.0.0.1:{port}" if over == "udp" else f"tcpin://127.0.0.1:{port}"
    async with vehicle(link, autopilot):
        said = await flown_by("pymavlink_client.py", url.format(port), autopilot)
        await is_down_in_the_north(f"{'udpin' if over == 'udp' else 'tcp'}:127.0.0.1:{port}")
    assert "logs 1" in said


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
async def test_mavproxy_flies_the_embedded_vehicle(tmp_path: Path, autopilot: str) -> None:
    port = free_port()
    async with vehicle(f"tcpin://127.0.0.1:{port}", autopilot):
        await flown_by("mavproxy_client.py", f"tcp:127.0.0.1:{port}", autopilot, str(tmp_path))
        await is_down_in_the_north(f"tcp:127.0.0.1:{port}")


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
async def test_a_mock_vehicle_answers_all_that_qgroundcontrol_asks(
    autopilot: str,
) -> None:
    async with mock_vehicle(autopilot, speed=SPEED) as mock:
        said = await flown_by("qgroundcontrol_client.py", mock.device, autopilot)
    assert "connected again" in said


@pytest.mark.skipif(find_spec("dronekit") is None, reason="dronekit is not installed")
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
async def test_dronekit_flies_the_embedded_vehicle(autopilot: str) -> None:
    port = free_port()
    async with vehicle(f"tcpin://127.0.0.1:{port}", autopilot):
        said = await flown_by("dronekit_client.py", f"tcp:127.0.0.1:{port}", autopilot)
        await is_down_in_the_north(f"tcp:127.0.0.1:{port}")
    assert "landed" in said
