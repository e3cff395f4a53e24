"""Missions and fences over the link, for both autopilots."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.bare_autopilot import BareAutopilot
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import PLACED

Scenario = Callable[[Any], Any]
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
GLOBAL_RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


def item(seq: int, command: int, kind: int, **values: Any) -> Any:
    params = values.get("params", (0.0, 0.0, 0.0, 0.0))
    usual = GLOBAL_RELATIVE if kind or command in PLACED else mavlink.MAV_FRAME_MISSION
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, seq, values.get("frame", usual), command, 0, 1, *params,
        values.get("x", 0), values.get("y", 0), values.get("z", 0.0), kind,
    )  # fmt: skip


def requests(r: Any) -> list[Any]:
    """Return what the vehicle asked for: PX4 by the new message, ArduPilot by the old."""
    return [m for _, m in r.heard if m.get_type() in {"MISSION_REQUEST_INT", "MISSION_REQUEST"}]


async def upload(r: Any, kind: int, items: list[Any]) -> int:
    """Upload as a ground station does; return the MAV_MISSION_RESULT."""
    r.last.pop("MISSION_ACK", None)
    before = len(requests(r))
    r.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), kind))
    for seq, each in enumerate(items):
        await r.until(
            lambda seq=seq: "MISSION_ACK" in r.last or len(requests(r)) > before + seq, limit_s=3.0
        )
        if "MISSION_ACK" in r.last:
            break
        assert requests(r)[-1].seq == seq
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
    r.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, kind))
    await asyncio.sleep(0.05)
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
                plain = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT if first else sent.frame
                assert (got.frame, got.param1) == (plain, sent.param1)
            r.send(mavlink.MAVLink_mission_clear_all_message(1, 1, kind))
            await asyncio.sleep(0.05)
            assert r.last["MISSION_ACK"].type == 0
            assert await download(r, kind) == []

    virtually(scenario())


def test_px4_clears_its_fence_outside_of_another_bound(rig: Any, virtually: Scenario) -> None:
    """With GF_MAX_VER_DIST breached, clearing removes both the list and the enforced areas."""

    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await r.hover()
            assert await upload(r, 1, square(r, 20.0)) == 0
            r.vehicle.autopilot.parameters.set("GF_ACTION", 2.0)
            r.vehicle.autopilot.parameters.set("GF_MAX_VER_DIST", 1.0)
            r.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 1))
            await asyncio.sleep(0.05)
            assert r.last["MISSION_ACK"].type == 0
            assert await download(r, 1) == []
            assert r.vehicle.autopilot.fence.areas == ()

    virtually(scenario())


@BOTH
def test_a_lost_item_is_asked_for_again(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(1.0)
            r.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 2))
            await asyncio.sleep(2.1)
            asked = [m.seq for m in requests(r)]
            # MAVLINK_MISSION_RETRY_TIMEOUT_DEFAULT of PX4, recv_timeout_ms of ArduPilot.
            assert asked == [0] * (9 if autopilot == "px4" else 3)
            # Out of order: asked again for the one that is due.
            r.send(item(1, 5100, 2))
            await asyncio.sleep(0.05)
            assert requests(r)[-1].seq == 0
            r.send(item(0, 5100, 2))
            r.send(item(1, 5100, 2))
            await asyncio.sleep(0.05)
            assert r.last["MISSION_ACK"].type == 0
            r.last.pop("MISSION_ACK")
            r.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 2))
            await asyncio.sleep(5.5)
            assert "MISSION_ACK" not in r.last
            await asyncio.sleep(3.5)
            if autopilot == "px4":
                # PX4 acknowledges nothing then.
                assert "MISSION_ACK" not in r.last
            else:
                cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
                assert r.last["MISSION_ACK"].type == cancelled
            r.send(mavlink.MAVLink_mission_request_int_message(1, 1, 99, 2))
            r.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 77))
            await asyncio.sleep(0.05)
            refused = [m.type for m in r.of("MISSION_ACK")[1 if autopilot == "px4" else 2 :]]
            # PX4 answers no request without a list, and of an unknown one none has space.
            assert refused == (
                [mavlink.MAV_MISSION_NO_SPACE]
                if autopilot == "px4"
                else [mavlink.MAV_MISSION_INVALID_SEQUENCE, mavlink.MAV_MISSION_UNSUPPORTED]
            )

    virtually(scenario())


@BOTH
def test_impossible_fences_are_invalid(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(4.0)
            assert await upload(r, 1, square(r, 20.0)) == 0
            invalid = mavlink.MAV_MISSION_INVALID
            assert await upload(r, 1, square(r, 20.0)[:3]) == invalid
            circle = item(0, 5003, 1, params=(-2.0, 0.0, 0.0, 0.0))
            assert await upload(r, 1, [circle]) == invalid
            assert await upload(r, 1, [item(0, 16, 1)]) == mavlink.MAV_MISSION_UNSUPPORTED
            # The old fence stays.
            assert len(await download(r, 1)) == 4

    virtually(scenario())


@pytest.mark.parametrize(
    ("kind", "autopilot", "most"), [(1, "px4", 64), (1, "ardupilot", 70), (2, "px4", 32)]
)
def test_no_more_items_are_taken_than_the_firmware_stores(
    rig: Any, virtually: Scenario, kind: int, autopilot: str, most: int
) -> None:
    """DM_KEY_FENCE_POINTS_MAX, DM_KEY_SAFE_POINTS_MAX; StorageFence. It took 700 of each."""

    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(4.0)
            command, params = (5003, (90.0, 0.0, 0.0, 0.0)) if kind == 1 else (5100, (0.0,) * 4)
            place = {"x": 473977420, "y": 85455940, "frame": 0}
            items = [item(seq, command, kind, params=params, **place) for seq in range(most + 1)]
            assert await upload(r, kind, items) == mavlink.MAV_MISSION_NO_SPACE
            assert await upload(r, kind, items[:-1]) == 0
            assert len(await download(r, kind)) == most

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
            # A landing counts as reached: so that a mission is finished for who waits for it.
            assert reached == ([0, 1, 2] if autopilot == "px4" else [1, 2, 3])

    virtually(scenario())


MISSION, ANY = mavlink.MAV_FRAME_MISSION, mavlink.MAV_MISSION_UNSUPPORTED


@pytest.mark.parametrize(
    ("command", "frame", "px4", "copter"),
    [
        (16, GLOBAL_RELATIVE, 0, 0),
        (16, MISSION, ANY, 0),
        (178, MISSION, 0, 0),
        (178, GLOBAL_RELATIVE, ANY, 0),
        (178, mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_MISSION_UNSUPPORTED_FRAME, 0),
    ],
)
def test_px4_wants_the_frame_of_an_item_s_kind(
    command: int, frame: int, px4: int, copter: int
) -> None:
    """parse_mavlink_mission_item of PX4; mavlink_int_to_mission_cmd of ArduPilot."""
    for autopilot, result in (("px4", px4), ("ardupilot", copter)):
        bare = BareAutopilot(autopilot)
        bare.run(3.0)
        bare.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
        bare.send(item(0, 16, 0, x=474000000, y=85500000, z=5.0))
        (ack,) = bare.send(item(1, command, 0, frame=frame, params=(1.0, 5.0, -1.0, 0.0)))
        assert (ack.get_type(), ack.type) == ("MISSION_ACK", result), autopilot


def test_arducopter_counts_no_home_without_a_mission_and_sends_plain_frames() -> None:
    """MissionItemProtocol_Waypoints::get_item, item_count; mission_cmd_to_mavlink_int."""
    bare = BareAutopilot("ardupilot")
    bare.run(25.0)
    ask = mavlink.MAVLink_mission_request_list_message(1, 1, 0)
    assert [each.count for each in bare.send(ask)] == [0]
    (refused,) = bare.send(mavlink.MAVLink_mission_request_list_message(1, 1, 9))
    assert refused.type == mavlink.MAV_MISSION_UNSUPPORTED
    assert bare.command(224, 0) == mavlink.MAV_RESULT_DENIED
    bare.send(mavlink.MAVLink_mission_count_message(1, 1, 3, 0))
    for each in (item(0, 16, 0), item(1, 16, 0, z=5.0), item(2, 178, 0)):
        bare.send(each)
    assert [each.count for each in bare.send(ask)] == [3]
    frames = [
        bare.send(mavlink.MAVLink_mission_request_int_message(1, 1, seq, 0))[0].frame
        for seq in range(3)
    ]
    assert frames == [0, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, 0]
    count, ack = bare.send(mavlink.MAVLink_mission_request_int_message(1, 1, 3, 0))
    assert (count.count, ack.type) == (3, mavlink.MAV_MISSION_ERROR)
    assert [bare.command(224, seq) for seq in (2, 3, -1)] == [0, 2, 2]


def texts_of(bare: BareAutopilot) -> list[str]:
    return [each.text for each in bare.run(0.04) if each.get_type() == "STATUSTEXT"]


def test_px4_takes_nothing_else_until_its_list_is_read() -> None:
    """mavlink_mission.cpp: MAVLINK_WPM_STATE_SENDLIST; as flown with 1.16."""
    bare = BareAutopilot("px4")
    bare.run(3.0)
    bare.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    bare.run(0.1)
    count = mavlink.MAVLink_mission_count_message(1, 1, 2, 0)
    ask = mavlink.MAVLink_mission_request_list_message(1, 1, 0)
    done = mavlink.MAVLink_mission_ack_message(1, 1, 0, 0)
    clear = mavlink.MAVLink_mission_clear_all_message(1, 1, 0)

    def wanted(seq: int) -> Any:
        return mavlink.MAVLink_mission_request_int_message(1, 1, seq, 0)

    def kinds(message: Any) -> list[str]:
        return [each.get_type() for each in bare.send(message)]

    assert kinds(wanted(0)) == []
    assert kinds(ask) == ["MISSION_COUNT"]
    assert bare.send(count)[0].type == mavlink.MAV_MISSION_ERROR
    assert texts_of(bare) == ["WPM: IGN MISSION_COUNT: Busy\t"]
    assert kinds(done) == []
    assert kinds(count) == ["MISSION_REQUEST_INT"]
    assert kinds(ask) == []
    bare.send(item(0, 16, 0, z=5.0))
    assert bare.send(count)[0].type == mavlink.MAV_MISSION_ERROR
    assert kinds(clear) == []
    assert bare.send(item(1, 16, 0, z=5.0))[0].type == mavlink.MAV_MISSION_ACCEPTED
    bare.run(0.1)
    # In their order, the last one again; one that is not next ends the download.
    assert kinds(ask) == ["MISSION_COUNT"]
    assert [kinds(wanted(seq)) for seq in (0, 0, 1)] == 3 * [["MISSION_ITEM_INT"]]
    assert kinds(wanted(0)) == ["MISSION_ACK"]
    assert kinds(wanted(1)) == []
    assert kinds(ask) == ["MISSION_COUNT"]
    bare.run(5.1)
    assert kinds(clear) == ["MISSION_ACK"]


@pytest.mark.parametrize(
    ("items", "why"),
    [
        ([(21, 0.0)], "starts with land waypoint."),
        ([(22, 0.0)], "Takeoff altitude below home altitude!"),
        ([(16, 5.0), (22, 5.0)], "takeoff not first waypoint item"),
        ([(178, 0.0), (22, 5.0), (21, 0.0)], None),
    ],
)
def test_px4_does_not_fly_a_mission_that_is_not_feasible(
    items: list[tuple[int, float]], why: str | None
) -> None:
    """FeasibilityChecker.cpp; the upload is accepted all the same."""
    bare = BareAutopilot("px4")
    bare.run(7.0)
    bare.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    bare.run(0.1)
    count = mavlink.MAVLink_mission_count_message(1, 1, len(items), 0)
    bare.send(count)
    assert bare.send(count)[0].seq == 0
    for seq, (command, z) in enumerate(items):
        (answer,) = bare.send(item(seq, command, 0, x=474000000, y=85500000, z=z))
    assert answer.type == mavlink.MAV_MISSION_ACCEPTED
    assert "".join(texts_of(bare)) == ("" if why is None else f"Mission rejected: {why}\t")
    result = mavlink.MAV_RESULT_ACCEPTED if why is None else mavlink.MAV_RESULT_DENIED
    assert bare.command(300) == result
