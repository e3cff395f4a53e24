"""Parameters, commands, intervals and identity over the link, for both autopilots."""

import asyncio
import math
import struct
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

Scenario = Callable[[Any], Any]
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


@BOTH
def test_lists_all_parameters(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(1.0)
            r.send(mavlink.MAVLink_param_request_list_message(1, 1))
            await asyncio.sleep(2.0)
            values = r.of("PARAM_VALUE")
            if autopilot == "px4":
                assert values.pop(0).param_id == "_HASH_CHECK"
            assert [m.param_index for m in values] == list(range(values[0].param_count))
            assert len({m.param_id for m in values}) == values[0].param_count
            assert [m.param_id for m in values] == sorted(m.param_id for m in values)

    virtually(scenario())


def test_px4_parameters_travel_bytewise(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await asyncio.sleep(1.0)
            r.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NAV_DLL_ACT", -1))
            await asyncio.sleep(0.05)
            value = r.last["PARAM_VALUE"]
            assert value.param_type == mavlink.MAV_PARAM_TYPE_INT32
            assert struct.pack("<f", value.param_value) == struct.pack("<i", 0)
            for number in (3, -1):
                bits = struct.unpack("<f", struct.pack("<i", number))[0]
                r.send(mavlink.MAVLink_param_set_message(1, 1, b"NAV_DLL_ACT", bits, 6))
                await asyncio.sleep(0.05)
                answer = r.last["PARAM_VALUE"]
                assert struct.pack("<f", answer.param_value) == struct.pack("<i", number)
                assert answer.param_index == value.param_index
                assert r.vehicle.autopilot.parameters["NAV_DLL_ACT"] == number
            # The wrong type is not taken, and the answer is the value that stands.
            r.send(mavlink.MAVLink_param_set_message(1, 1, b"NAV_DLL_ACT", 5.0, 9))
            await asyncio.sleep(0.05)
            assert r.vehicle.autopilot.parameters["NAV_DLL_ACT"] == -1

    virtually(scenario())


def test_ardupilot_parameters_are_cast(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="ardupilot") as r:
            await asyncio.sleep(1.0)
            r.send(mavlink.MAVLink_param_set_message(1, 1, b"FS_GCS_ENABLE", 5.0, 9))
            await asyncio.sleep(0.05)
            answer = r.last["PARAM_VALUE"]
            assert (answer.param_value, answer.param_type) == (5.0, mavlink.MAV_PARAM_TYPE_INT8)
            assert answer.param_index == 65535
            for name, index, told in ((b"LAND_SPEED", -1, 65535), (b"", 5, 5)):
                r.send(mavlink.MAVLink_param_request_read_message(1, 1, name, index))
                await asyncio.sleep(0.05)
                assert r.last["PARAM_VALUE"].param_index == told
            r.send(mavlink.MAVLink_param_set_message(1, 1, b"LAND_SPEED", 25.0, 9))
            await asyncio.sleep(0.05)
            assert r.last["PARAM_VALUE"].param_value == 25.0
            before = len(r.of("PARAM_VALUE"))
            r.send(mavlink.MAVLink_param_set_message(1, 1, b"NO_SUCH", 5.0, 9))
            r.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
            r.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 30000))
            await asyncio.sleep(0.05)
            assert len(r.of("PARAM_VALUE")) == before
            r.send(mavlink.MAVLink_param_set_message(1, 1, b"LAND_SPEED", math.nan, 9))
            await asyncio.sleep(0.05)
            assert r.last["PARAM_VALUE"].param_value == 25.0

    virtually(scenario())


@BOTH
def test_answers_timesync_and_ping(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            # Not at a step of the vehicle: these are taken in pairs, 8 ms apart.
            await asyncio.sleep(2.0057)
            r.send(mavlink.MAVLink_timesync_message(0, 123456789))
            r.send(mavlink.MAVLink_ping_message(5, 6, 0, 0))
            await asyncio.sleep(0.05)
            answer = next(m for m in r.of("TIMESYNC") if m.ts1 == 123456789)
            assert answer.tc1 / 1e9 == pytest.approx(2.0057 + 0.003, abs=2e-4)
            ping = r.last["PING"]
            assert (ping.time_usec, ping.seq, ping.target_system) == (5, 6, 255)
            # An answer is not answered.
            before = len(r.of("TIMESYNC"))
            r.send(mavlink.MAVLink_timesync_message(77, 88))
            await asyncio.sleep(0.05)
            assert not [m for m in r.of("TIMESYNC")[before:] if m.ts1 == 88]

    virtually(scenario())


@BOTH
def test_message_intervals(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(1.0)
            assert await r.command(511, 30, 1e6 / 25) == 0
            assert await r.command(510, 30) == 0
            assert r.last["MESSAGE_INTERVAL"].interval_us == 40000
            before = len(r.of("ATTITUDE"))
            await asyncio.sleep(4.0)
            assert len(r.of("ATTITUDE")) - before == pytest.approx(100, abs=2)
            assert await r.command(511, 30, -1) == 0
            before = len(r.of("ATTITUDE"))
            await asyncio.sleep(2.0)
            assert len(r.of("ATTITUDE")) == before
            assert await r.command(511, 30, 0) == 0
            await asyncio.sleep(2.0)
            default_hz = 20 if autopilot == "px4" else 0
            assert len(r.of("ATTITUDE")) - before == pytest.approx(2 * default_hz, abs=2)
            denied, failed = mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED
            no_stream, no_message = (failed, denied) if autopilot == "px4" else (denied, failed)
            assert await r.command(511, 999999, 1000) == no_stream
            assert await r.command(511, 30, 50000, 1) == no_stream
            assert await r.command(511, 30, 50000, math.nan) == 0
            assert await r.command(512, 999999) == no_message
            # ArduPilot sends nothing at more than its loop rate.
            assert await r.command(511, 30, 2000) == (0 if autopilot == "px4" else denied)

    virtually(scenario())


@BOTH
def test_unknown_commands_are_unsupported_and_others_left_alone(
    rig: Any, virtually: Scenario, autopilot: str
) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(1.0)
            assert await r.command(31000) == mavlink.MAV_RESULT_UNSUPPORTED
            r.send(mavlink.MAVLink_command_long_message(9, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
            r.send(mavlink.MAVLink_command_long_message(1, 100, 400, 0, 1, 0, 0, 0, 0, 0, 0))
            r.link.write(bytes(range(256)) * 3 + bytes(300))
            await asyncio.sleep(0.1)
            assert [m.command for m in r.of("COMMAND_ACK")] == [31000]
            # To all systems: PX4 obeys no such command but those of discovery, nor parameters.
            r.send(mavlink.MAVLink_command_long_message(0, 0, 512, 0, 24, 0, 0, 0, 0, 0, 0))
            r.send(mavlink.MAVLink_param_request_list_message(0, 0))
            r.send(mavlink.MAVLink_mission_request_list_message(0, 0))
            await asyncio.sleep(0.5)
            for answer in ("COMMAND_ACK", "PARAM_VALUE", "MISSION_COUNT"):
                assert len(r.of(answer)) > (answer == "COMMAND_ACK") or autopilot == "px4", answer
                assert len(r.of(answer)) <= (answer == "COMMAND_ACK") or autopilot != "px4", answer
            r.send(mavlink.MAVLink_command_long_message(0, 0, 520, 0, 1, 0, 0, 0, 0, 0, 0))
            await asyncio.sleep(0.1)
            assert "AUTOPILOT_VERSION" in r.last

    virtually(scenario())


@BOTH
def test_identity_can_be_given(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot, uid=77, uid2=b"board 12", system_id=1) as r:
            await r.command(512, 148)
            version = r.last["AUTOPILOT_VERSION"]
            assert version.uid == 77
            assert bytes(version.uid2).rstrip(b"\0") == b"board 12"

    virtually(scenario())


@BOTH
def test_reboots_only_disarmed_and_keeps_its_parameters(
    rig: Any, virtually: Scenario, autopilot: str
) -> None:
    name = "MIS_TAKEOFF_ALT" if autopilot == "px4" else "GUID_TIMEOUT"

    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await r.hover()
            refused = mavlink.MAV_RESULT_DENIED if autopilot == "px4" else mavlink.MAV_RESULT_FAILED
            assert await r.command(246, 1) == refused
            await r.command(21)
            await r.until(lambda: not r.armed)
            r.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), 0.75, 9))
            await asyncio.sleep(0.05)
            assert await r.command(246, 1) == 0
            assert r.vehicle.autopilot.t_s < 1.0
            assert r.vehicle.autopilot.parameters[name] == 0.75
            await r.hover()

    virtually(scenario())


@BOTH
def test_home_is_set_asked_for_and_moved(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(1.0)
            refused = mavlink.MAV_RESULT_DENIED if autopilot == "px4" else mavlink.MAV_RESULT_FAILED
            assert await r.command(410) == refused
            await asyncio.sleep(24.0)
            assert await r.command(410) == 0
            home = r.last["HOME_POSITION"]
            assert home.latitude == pytest.approx(473977420, abs=5)
            assert await r.command(179, 0, 0, 0, 0, 47.4, 8.55, 490.0) == 0
            await asyncio.sleep(0.1)
            assert r.last["HOME_POSITION"].latitude == pytest.approx(474000000, abs=20)
            assert await r.command(179, 0, 0, 0, 0, math.nan, 8.55, 490.0) == refused

    virtually(scenario())
