"""The mavsdk process for real: what it says, how it ends, and what is left of it."""

import asyncio
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from copy import copy
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.mavsdk import mavsdk_client
from wil_campaign.plugins.mavsdk.mavsdk_backend import MavsdkBackend
from wil_campaign.plugins.mavsdk.mavsdk_client import MavsdkClient
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.onboard.mission_protocol import (
    ItemList,
    MissionError,
    MissionItem,
)
from wil_campaign.vehicles.driver.onboard.parameters import encode_parameter
from wil_campaign.vehicles.errors import CommandError, VehicleError
from wil_campaign.vehicles.links.link import LinkError
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.setpoints import VelocitySetpoint

ROOT = Path(__file__).parents[3]
NAN = float("nan")
INT32 = mavlink.MAV_PARAM_TYPE_INT32
SAID: tuple[Any, ...] = (
    mavlink.MAVLink_vision_position_estimate_message(
        2**40 + 1, 1.0, 2.0, 3.0, 0.5, 0.25, 0.125, [NAN] * 21, 3
    ),
    mavlink.MAVLink_odometry_message(
        5, 1, 12, 1.0, 2.0, 3.0, [1.0, 0.0, 0.0, 0.0], *[0.5] * 6, [NAN] * 21, [0.0] * 21, 1, 2, 90
    ),
    mavlink.MAVLink_obstacle_distance_message(5, 0, list(range(72)), 5, 20, 1000, 5.0, 0.0, 12),
    mavlink.MAVLink_obstacle_distance_3d_message(5, 0, 12, 65535, 1.0, 2.0, 3.0, 0.5, 10.0),
    mavlink.MAVLink_distance_sensor_message(5, 10, 1000, 300, 0, 1, 25, 0),
    mavlink.MAVLink_landing_target_message(
        5, 1, 12, 0.5, 0.25, 3.0, 0.0, 0.0, 1.0, 2.0, 3.0, [1.0, 0.0, 0.0, 0.0], 2, 1
    ),
    mavlink.MAVLink_adsb_vehicle_message(
        0xABCDEF, 473_977_419, -85_455_939, 1, 3, 4, 5, -6, b"CALLSIGN"[:8], 14, 1, 3, 1200
    ),
    mavlink.MAVLink_collision_message(0, 7, 0, 2, 1.0, 2.0, 3.0),
    mavlink.MAVLink_gps_input_message(
        5, 1, 8, 3, 4, 5, 473_977_419, 1, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11
    ),
    mavlink.MAVLink_statustext_message(6, b"a text"),
)


def frame(message: Any) -> bytes:
    return MavlinkCodec(system_id=1, component_id=1).pack(copy(message))


def gone(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state == "Z"


async def until(condition: Callable[[], bool], within_s: float = 10.0) -> None:
    async with asyncio.timeout(within_s):
        while not condition():  # noqa: ASYNC110 - other processes set no event of ours
            await asyncio.sleep(0.02)


async def arrives(peer: Any, kind: str, send: Callable[[], None]) -> None:
    """Send again until it is heard: what is too late for mavsdk on a busy machine is not sent."""
    for _ in range(20):
        with suppress(TimeoutError):
            await until(lambda: bool(peer.of_type(kind)), 3.0)
            return
        send()
    pytest.fail(f"no {kind} arrived")


async def test_each_message_arrives_as_it_was_meant(
    fake_pair: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mavsdk_client, "_FLYING_SILENT_S", 30.0)
    setpoint = VelocitySetpoint((1.5, -2.25, 0.5), yaw_rad=0.25)
    link, peer = fake_pair("px4")
    voice = MavsdkBackend(name="real")
    async with peer, Driver(name="real", link=link, system_id=1, backend=voice) as driver:
        await driver.identify(60.0)
        await driver.ready(60.0)
        for message in SAID:
            driver.send_message(message)
        driver.send(setpoint)
        sent = 1

        def send_again() -> None:
            nonlocal sent
            sent += 1
            driver.send(setpoint)

        await arrives(peer, "SET_POSITION_TARGET_LOCAL_NED", send_again)
        for message in SAID:
            await arrives(peer, message.get_type(), partial(driver.send_message, message))
            heard = peer.of_type(message.get_type())
            assert frame(heard[-1]) == frame(message)
            assert (heard[-1].get_srcSystem(), heard[-1].get_srcComponent()) == (245, 190)
        for one in peer.of_type("SET_POSITION_TARGET_LOCAL_NED"):
            assert (one.vx, one.vy, one.vz, one.yaw) == (1.5, -2.25, 0.5, 0.25)
        assert len(peer.of_type("HEARTBEAT")) >= 1
        await asyncio.sleep(0.5)
        assert len(peer.of_type("SET_POSITION_TARGET_LOCAL_NED")) <= sent, (
            "nobody repeats it for us"
        )


async def test_a_negative_integer_arrives_bit_by_bit(fake_pair: Callable[..., Any]) -> None:
    """PX4's -1 is the bytes of a NaN, and JSON knows one NaN only: 2143289344."""
    link, peer = fake_pair("px4")
    peer.parameters["COM_FLTMODE1"] = (encode_parameter(3, INT32, bytewise=True), INT32)
    voice = MavsdkBackend(name="real")
    async with peer, Driver(name="real", link=link, system_id=1, backend=voice) as driver:
        await driver.identify(60.0)
        for value in (-1, -8_388_608, 7, -2):
            await driver.parameters.set("COM_FLTMODE1", value)
            assert await driver.parameters.get("COM_FLTMODE1") == value
        (sender,) = {(m.get_srcSystem(), m.get_srcComponent()) for m in peer.of_type("PARAM_SET")}
        assert sender == (245, 190)


async def test_a_refusal_of_the_vehicle_is_an_error_in_words(fake_pair: Callable[..., Any]) -> None:
    link, peer = fake_pair("px4")
    peer.replies["COMMAND_LONG:21"] = lambda peer, message: peer.ack(message, 2)
    peer.replies["COMMAND_LONG:512"] = lambda peer, _: peer.say(
        mavlink.MAVLink_autopilot_version_message(
            mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT,
            0x01120080,
            0,
            0,
            0,
            *[[0] * 8] * 3,
            0,
            0,
            77,
        )
    )
    peer.replies["MISSION_COUNT"] = lambda peer, _: peer.say(
        mavlink.MAVLink_mission_ack_message(245, 190, mavlink.MAV_MISSION_DENIED, 0)
    )
    async with peer, Driver(name="real", link=link, backend=MavsdkBackend(name="real")) as driver:
        await driver.identify(60.0)
        with pytest.raises(CommandError, match=r"Action\.land: mavsdk reports COMMAND_DENIED"):
            await driver.land()
        with pytest.raises(MissionError, match="it was refused: mavsdk reports DENIED"):
            await driver.onboard.missions.upload(ItemList.MISSION, [MissionItem(command=16)])


async def test_a_process_that_is_killed_is_an_error_at_once(fake_pair: Callable[..., Any]) -> None:
    link, peer = fake_pair("px4")
    voice = MavsdkBackend(name="real")
    said = r"real: the mavsdk process was ended by SIGKILL; nothing more is sent to it"
    failures: list[VehicleError] = []
    async with peer, Driver(name="real", link=link, system_id=1, backend=voice) as driver:
        driver.on_failure(failures.append)
        await driver.identify(60.0)
        await driver.ready(60.0)
        peer.armed = True
        peer.heartbeat()
        await until(lambda: driver.state.armed)
        waits = asyncio.ensure_future(driver.disarmed(60.0))
        await asyncio.sleep(0.1)
        began_s = time.monotonic()
        os.kill(voice.client.pid or 0, signal.SIGKILL)
        with pytest.raises(VehicleError, match=said):
            await waits
        assert time.monotonic() - began_s < 30.0
        assert [str(error) for error in failures] == [str(failures[0])]
        peer.armed = False
        peer.heartbeat()
        await until(lambda: not driver.state.armed)
        for order in (driver.land, driver.arm, driver.hold):
            with pytest.raises(VehicleError, match=said):
                await order()
        with pytest.raises(VehicleError, match=said):
            driver.send(VelocitySetpoint((0.0, 0.0, 0.0)))
        # It is heard still, and what was put aboard can be taken back.
        peer.parameters["A"] = (1.0, mavlink.MAV_PARAM_TYPE_REAL32)
        await driver.parameters.set("A", 2.0)
        assert driver.state.link_up


async def test_a_process_that_hangs_is_an_error_and_killed(fake_pair: Callable[..., Any]) -> None:
    link, peer = fake_pair("px4")
    voice = MavsdkBackend(name="real")
    async with peer, Driver(name="real", link=link, system_id=1, backend=voice) as driver:
        failed = asyncio.get_running_loop().create_future()
        driver.on_failure(failed.set_result)
        await driver.identify(60.0)
        await driver.ready(60.0)
        driver.keep_still()
        pid = voice.client.pid or 0
        os.kill(pid, signal.SIGSTOP)
        async with asyncio.timeout(10.0):
            assert "real: the mavsdk process hangs: no response for" in str(await failed)
        await until(lambda: gone(pid))


async def test_a_process_that_cannot_start_says_why() -> None:
    client = MavsdkClient(name="real")
    with pytest.raises(LinkError, match=r"the mavsdk process ended with exit code 1: mavsdk "):
        await client.start("nonsense://somewhere")
    assert gone(client.pid or 0)


async def test_without_the_package_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "mavsdk.py"
    file.write_text("raise ModuleNotFoundError(\"No module named 'mavsdk'\")")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{ROOT}")
    with pytest.raises(LinkError, match=r"exit code 1: .* needs .* pip install 'mavsdk>=4\.1,<5'"):
        await MavsdkClient(name="real").start("udpout://127.0.0.1:9")


async def test_it_ends_with_its_driver_even_when_it_is_stopped(tmp_path: Path) -> None:
    program = """
import asyncio, os, pathlib, signal, sys
from wil_campaign.plugins.mavsdk.mavsdk_client import MavsdkClient

async def main():
    client = MavsdkClient(name="real")
    await client.start("udpout://127.0.0.1:9")
    os.kill(client.pid, signal.SIGSTOP)
    pathlib.Path(sys.argv[1]).write_text(str(client.pid))
    os.kill(os.getpid(), signal.SIGKILL)

asyncio.run(main())
"""
    file = tmp_path / "pid"
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", program, str(file)), env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert await process.wait() == -signal.SIGKILL
    pid = int(file.read_text("ascii"))
    await until(lambda: gone(pid))


async def test_without_a_driver_it_says_how_it_is_used() -> None:
    for arguments, said in (((), "usage:"), (("udpout://127.0.0.1:9",), "is not a socket")):
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "wil_campaign.plugins.mavsdk", *arguments),
            stdin=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            cwd=ROOT,
        )
        _, err = await process.communicate()
        assert (process.returncode, said in err.decode()) == (2, True)
