"""Parameters, missions, fences, intervals and identity, over the link, for both autopilots."""

import asyncio
import math
import struct
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

Scenario = Callable[[Any], Any]
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
GLOBAL_RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


def item(seq: int, command: int, kind: int, **values: Any) -> Any:
    params = values.get("params", (0.0, 0.0, 0.0, 0.0))
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, seq, values.get("frame", GLOBAL_RELATIVE), command, 0, 1, *params,
        values.get("x", 0), values.get("y", 0), values.get("z", 0.0), kind,
    )  # fmt: skip


async def upload(r: Any, kind: int, items: list[Any]) -> int:
    """Upload as a ground station does; return the MAV_MISSION_RESULT."""
    r.last.pop("MISSION_ACK", None)
    r.last.pop("MISSION_REQUEST_INT", None)
    r.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), kind))
    for seq, each in enumerate(items):
        await r.until(
            lambda seq=seq: getattr(r.last.get("MISSION_REQUEST_INT"), "seq", -1) == seq,
            limit_s=3.0,
        )
        r.send(each)
    await r.until(lambda: "MISSION_ACK" in r.last, limit_s=3.0)
    ack = r.last["MISSION_ACK"]
    assert (ack.target_system, ack.target_component) == (255, 190)
    assert ack.mission_type == kind
    return int(ack.type)


async def download(r: Any, kind: int) -> list[Any]:
    r.send(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
    await asyncio.sleep(0.05)
    count = r.last["MISSION_COUNT"]
    assert count.mission_type == kind
    items = []
    for seq in range(count.count):
        r.send(mavlink.MAVLink_mission_request_int_message(1, 1, seq, kind))
        await asyncio.sleep(0.05)
        items.append(r.last["MISSION_ITEM_INT"])
        assert items[-1].seq == seq
    return items


def square(r: Any, half_m: float, *, inside: bool = True) -> list[Any]:
    command = 5001 if inside else 5002
    corners = [(half_m, half_m), (half_m, -half_m), (-half_m, -half_m), (-half_m, half_m)]
    items = []
    for seq, (north, east) in enumerate(corners):
        place = r.vehicle.autopilot.state.frame.to_geodetic((north, east, 0.0))
        x, y = round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7)
        items.append(item(seq, command, 1, params=(4.0, 0.0, 0.0, 0.0), x=x, y=y, frame=0))
    return items


@BOTH
def test_lists_all_parameters(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(1.0)
            r.send(mavlink.MAVLink_param_request_list_message(1, 1))
            await asyncio.sleep(2.0)
            values = r.of("PARAM_VALUE")
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
            r.send(mavlink.MAVLink_param_set_message(1, 1, b"LAND_SPD_MS", 0.25, 9))
            await asyncio.sleep(0.05)
            assert r.last["PARAM_VALUE"].param_value == 0.25
            before = len(r.of("PARAM_VALUE"))
            r.send(mavlink.MAVLink_param_set_message(1, 1, b"NO_SUCH", 5.0, 9))
            r.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
            r.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 30000))
            await asyncio.sleep(0.05)
            assert len(r.of("PARAM_VALUE")) == before
            r.send(mavlink.MAVLink_param_set_message(1, 1, b"LAND_SPD_MS", math.nan, 9))
            await asyncio.sleep(0.05)
            assert r.last["PARAM_VALUE"].param_value == 0.25

    virtually(scenario())


@BOTH
@pytest.mark.parametrize("kind", [0, 1, 2])
def test_lists_are_uploaded_read_back_and_cleared(
    rig: Any, virtually: Scenario, autopilot: str, kind: int
) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(4.0)
            if kind == 1:
                items = square(r, 20.0)
            else:
                command = 16 if kind == 0 else 5100
                items = [
                    item(seq, command, kind, x=473977400 + seq, y=85455900, z=2.0 + seq)
                    for seq in range(3)
                ]
            assert await upload(r, kind, items) == 0
            back = await download(r, kind)
            # Item 0 of ArduPilot's missions is home, whatever was sent.
            first = 1 if (autopilot, kind) == ("ardupilot", 0) else 0
            for sent, got in list(zip(items, back, strict=True))[first:]:
                assert (got.command, got.x, got.y, got.z) == (sent.command, sent.x, sent.y, sent.z)
                assert (got.frame, got.param1) == (sent.frame, sent.param1)
            r.send(mavlink.MAVLink_mission_clear_all_message(1, 1, kind))
            await asyncio.sleep(0.05)
            assert r.last["MISSION_ACK"].type == 0
            left = 1 if (autopilot, kind) == ("ardupilot", 0) else 0
            assert len(await download(r, kind)) == left

    virtually(scenario())


@BOTH
def test_a_lost_item_is_asked_for_again(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(1.0)
            r.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 2))
            await asyncio.sleep(1.3)
            asked = [m.seq for m in r.of("MISSION_REQUEST_INT")]
            assert asked == [0, 0, 0]
            # Out of order: asked again for the one that is due.
            r.send(item(1, 5100, 2))
            await asyncio.sleep(0.05)
            assert r.last["MISSION_REQUEST_INT"].seq == 0
            r.send(item(0, 5100, 2))
            r.send(item(1, 5100, 2))
            await asyncio.sleep(0.05)
            assert r.last["MISSION_ACK"].type == 0
            r.last.pop("MISSION_ACK")
            r.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 2))
            await asyncio.sleep(6.0)
            cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
            assert r.last["MISSION_ACK"].type == cancelled
            r.send(mavlink.MAVLink_mission_request_int_message(1, 1, 99, 2))
            r.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 77))
            await asyncio.sleep(0.05)
            refused = [m.type for m in r.of("MISSION_ACK")[-2:]]
            assert refused == [
                mavlink.MAV_MISSION_INVALID_SEQUENCE,
                mavlink.MAV_MISSION_UNSUPPORTED,
            ]

    virtually(scenario())


@BOTH
def test_fences_that_are_none_are_invalid(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(4.0)
            assert await upload(r, 1, square(r, 20.0)) == 0
            invalid = mavlink.MAV_MISSION_INVALID
            assert await upload(r, 1, square(r, 20.0)[:3]) == invalid
            circle = item(0, 5003, 1, params=(-2.0, 0.0, 0.0, 0.0))
            assert await upload(r, 1, [circle]) == invalid
            assert await upload(r, 1, [item(0, 16, 1)]) == invalid
            # The old fence stays.
            assert len(await download(r, 1)) == 4

    virtually(scenario())


def test_px4_refuses_a_fence_without_home(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await asyncio.sleep(5.0)
            denied = mavlink.MAV_MISSION_DENIED
            assert await upload(r, 1, square(r, 5.0, inside=False)) == denied
            assert await upload(r, 1, square(r, 5.0)) == 0

    virtually(scenario())


def test_px4_acts_on_its_fence(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4", parameters={"GF_ACTION": 5, "COM_FAIL_ACT_T": 0}) as r:
            await asyncio.sleep(5.0)
            assert await upload(r, 1, square(r, 3.0)) == 0
            await r.hover()
            await r.stream(0.3, mask=3527, velocity=(1.0, 0.0, 0.0))
            await r.command(176, 1, 6)
            await r.stream(4.5, mask=3527, velocity=(1.0, 0.0, 0.0))
            assert r.custom_mode == 0x06040000
            assert r.status == mavlink.MAV_STATE_CRITICAL
            await r.until(lambda: not r.armed)
            assert r.vehicle.truth().pose.position_ned_m[0] == pytest.approx(3.6, abs=0.6)

    virtually(scenario())


def test_copter_acts_on_its_fence_when_it_is_on(rig: Any, virtually: Scenario) -> None:
    async def scenario(enabled: int) -> int:
        async with rig(autopilot="ardupilot", parameters={"FENCE_ACTION": 2}) as r:
            await asyncio.sleep(30.0)
            assert await upload(r, 1, square(r, 3.0)) == 0
            assert await r.command(207, enabled) == 0
            await r.hover()
            await r.stream(5.0, mask=3527, velocity=(1.0, 0.0, 0.0))
            said = [text for text in r.texts() if "fence breached" in text]
            assert said == (["Polygon fence breached"] if enabled else [])
            return int(r.custom_mode)

    assert virtually(scenario(1)) == 9
    assert virtually(scenario(0)) == 4


def test_copter_does_not_arm_outside_its_fence(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="ardupilot", parameters={"FENCE_ENABLE": 1}) as r:
            await asyncio.sleep(30.0)
            assert await upload(r, 1, square(r, 3.0, inside=False)) == 0
            assert await r.command(400, 1) == mavlink.MAV_RESULT_FAILED
            await asyncio.sleep(0.05)
            assert "Arm: vehicle outside fence" in r.texts()

    virtually(scenario())


@BOTH
def test_flies_an_uploaded_mission(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(7.0 if autopilot == "px4" else 42.0)
            goal = r.vehicle.autopilot.state.frame.to_geodetic((12.0, 0.0, 0.0))
            x, y = round(goal.latitude_deg * 1e7), round(goal.longitude_deg * 1e7)
            items = [item(0, 22, 0, z=3.0), item(1, 16, 0, x=x, y=y, z=3.0), item(2, 21, 0)]
            if autopilot == "ardupilot":
                home = item(0, 16, 0)
                items = [home, *(i for i in items)]
                for seq, each in enumerate(items):
                    each.seq = seq
            assert await upload(r, 0, items) == 0
            if autopilot == "px4":
                assert await r.command(400, 1) == 0
                assert await r.command(176, 1, 4, 4) == 0
            else:
                await r.command(176, 1, 4)
                assert await r.command(400, 1) == 0
                assert await r.command(300) == 0
            await r.until(lambda: r.height_m > 2.0)
            await r.until(lambda: not r.armed)
            north_m = r.vehicle.truth().pose.position_ned_m[0]
            assert north_m == pytest.approx(12.0, abs=2.5)
            reached = [m.seq for m in r.of("MISSION_ITEM_REACHED")]
            assert reached == ([0, 1] if autopilot == "px4" else [1, 2])

    virtually(scenario())


@BOTH
def test_answers_timesync_and_ping(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(2.0)
            r.send(mavlink.MAVLink_timesync_message(0, 123456789))
            r.send(mavlink.MAVLink_ping_message(5, 6, 0, 0))
            await asyncio.sleep(0.05)
            answer = next(m for m in r.of("TIMESYNC") if m.ts1 == 123456789)
            assert answer.tc1 / 1e9 == pytest.approx(2.0, abs=0.02)
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
            assert await r.command(511, 999999, 1000) == mavlink.MAV_RESULT_DENIED
            assert await r.command(512, 999999) == mavlink.MAV_RESULT_FAILED

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
            # Broadcast is for everybody.
            r.send(mavlink.MAVLink_command_long_message(0, 0, 512, 0, 148, 0, 0, 0, 0, 0, 0))
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
    name = "MIS_TAKEOFF_ALT" if autopilot == "px4" else "LAND_SPD_MS"

    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await r.hover()
            assert await r.command(246, 1) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
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
            assert await r.command(410) == mavlink.MAV_RESULT_FAILED
            await asyncio.sleep(24.0)
            assert await r.command(410) == 0
            home = r.last["HOME_POSITION"]
            assert home.latitude == pytest.approx(473977420, abs=5)
            assert await r.command(179, 0, 0, 0, 0, 47.4, 8.55, 490.0) == 0
            await asyncio.sleep(0.1)
            assert r.last["HOME_POSITION"].latitude == pytest.approx(474000000, abs=20)
            assert await r.command(179, 0, 0, 0, 0, math.nan, 8.55, 490.0) == (
                mavlink.MAV_RESULT_DENIED
            )

    virtually(scenario())
