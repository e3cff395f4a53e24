"""What arrives from a vehicle's own link is not what it seems: in virtual time, by a relay."""

import asyncio
import math
from collections.abc import Iterable
from functools import partial
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.faults.relay import LOCAL_POSITION_NED
from tests.faults.wire_changes import (
    COMPANION,
    GENERIC,
    STATION,
    Board,
    Hold,
    OtherSender,
    Router,
    WireChange,
    headed,
    not_a_number,
    through,
    without_hold,
)
from tests.orchestrator.conftest import BRIEF, Fly
from tests.orchestrator.flights import all_landed, log_of
from wil_campaign.orchestrator.run_results.caveats import campaign_caveats
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.vehicles.mavlink.heartbeats import HeartbeatKind

PX4 = HeartbeatKind(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4)
_QUATERNION: int = mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
AUTOPILOTS = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


def flown(fly_run: Fly, autopilot: str, change: WireChange, *sets: str) -> Any:
    """Fly the gate's twin alone, a step ahead, judged by its estimate."""
    given = (*BRIEF, f"vehicles.twin.autopilot={autopilot}", *sets)
    return fly_run("gate", "large", "sim", sets=given, disturb=through(change))


@AUTOPILOTS
@pytest.mark.parametrize("over_s", [0.0, 3.0])
def test_heading_corrected_in_flight_is_no_pass(
    fly_run: Fly, autopilot: str, over_s: float
) -> None:
    """It is 25 degrees wrong on the ground, and corrected at height, at once or over seconds."""
    began_s: list[float] = []

    def change(frame: MavlinkFrame, run_state: RunState) -> Iterable[bytes]:
        if frame.message_id != mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
            yield frame.raw
            return
        now_s = asyncio.get_running_loop().time()
        if run_state.reached("at_height"):
            began_s.append(now_s)
        gone_s = now_s - began_s[0] if began_s else 0.0
        left = 1.0 if not began_s else max(0.0, 1.0 - gone_s / over_s) if over_s else 0.0
        yield headed(frame, math.radians(25.0) * left)

    result, folder = flown(fly_run, autopilot, change)
    assert result.verdict == "INVALID"
    assert "its heading is turned by" in result.reason
    assert all_landed(folder)


@AUTOPILOTS
def test_sound_heading_is_compared_with_all_that_there_is(fly_run: Fly, autopilot: str) -> None:
    result, _ = flown(fly_run, autopilot, lambda frame, _: (frame.raw,))
    assert result.verdict == "PASS", result.reason
    (pose,) = [one for one in result.evidence if one.signal == "pose" and one.vehicle == "twin"]
    assert {"gyroscopes", "magnetometer", "truth"} <= set(pose.compared_with)


@AUTOPILOTS
@pytest.mark.parametrize("message_id", [LOCAL_POSITION_NED, _QUATERNION])
@pytest.mark.parametrize("each", [1, 3])
def test_an_estimate_that_is_not_a_number_is_no_pass(
    fly_run: Fly, autopilot: str, message_id: int, each: int
) -> None:
    """Every third leaves no gap: the others come often enough."""
    came: list[int] = []

    def change(frame: MavlinkFrame, run_state: RunState) -> Iterable[bytes]:
        if frame.message_id == message_id and run_state.reached("goal"):
            came.append(1)
            if len(came) % each == 0:
                yield not_a_number(frame)
                return
        yield frame.raw

    result, folder = flown(fly_run, autopilot, change)
    assert result.verdict == "INVALID"
    name = "ATTITUDE_QUATERNION" if message_id == _QUATERNION else "LOCAL_POSITION_NED"
    assert f"pose of twin from mavlink: its {name} is no" in result.reason
    assert all_landed(folder)


@pytest.mark.parametrize(
    ("until", "sets"), [("takeoff", ()), ("end", ("vehicles.twin.pose_source=mocap",))]
)
def test_an_estimate_that_is_not_a_number_matters_in_flight_where_it_is_judged(
    fly_run: Fly, until: Stage, sets: tuple[str, ...]
) -> None:
    came: list[int] = []

    def change(frame: MavlinkFrame, run_state: RunState) -> Iterable[bytes]:
        if frame.message_id == LOCAL_POSITION_NED and not run_state.reached(until):
            came.append(1)
            yield not_a_number(frame) if len(came) % 3 == 0 else frame.raw
        else:
            yield frame.raw

    result, folder = flown(fly_run, "px4", change, *sets)
    assert len(came) > 10
    assert (result.verdict, result.reason) == ("PASS", "")
    assert any(event.get("kind") == "unusable_estimate" for event in log_of(folder))


def _without_hold(frame: MavlinkFrame, run_state: RunState, what: Hold) -> Iterable[bytes]:
    """Take the fix, the absolute position, or trust in the GPS from an estimator at its goal."""
    yield without_hold(frame, what) if run_state.reached("goal") else frame.raw


@AUTOPILOTS
@pytest.mark.parametrize(
    ("what", "flag"),
    [("fix", "fix_type 1"), ("absolute", "POS_HORIZ_ABS"), ("glitch", "GLITCH")],
)
def test_estimators_loss_is_invalid(fly_run: Fly, autopilot: str, what: Hold, flag: str) -> None:
    result, folder = flown(fly_run, autopilot, partial(_without_hold, what=what))
    assert result.verdict == "INVALID"
    assert result.reason.startswith("pose of twin from mavlink: ")
    assert flag in result.reason
    events = [one for one in log_of(folder) if one.get("kind") == "fault"]
    assert flag in events[0]["text"]
    assert [one.verdict for one in result.also[:1]] == ["FAIL"]  # vehicle_fault, of the same time
    assert all_landed(folder)


@AUTOPILOTS
def test_fix_that_is_lost_is_a_fault_whatever_is_judged(fly_run: Fly, autopilot: str) -> None:
    captured = "vehicles.twin.pose_source=mocap"
    result, _ = flown(fly_run, autopilot, partial(_without_hold, what="fix"), captured)
    assert result.verdict == "FAIL"
    assert result.reason.startswith("twin: its GPS has lost its fix (GPS_RAW_INT fix_type 1)")


@AUTOPILOTS
def test_dead_reckoning_that_is_permitted_is_a_caveat(fly_run: Fly, autopilot: str) -> None:
    permit = "vehicles.twin.permit_dead_reckoning=true"
    result, folder = flown(fly_run, autopilot, partial(_without_hold, what="absolute"), permit)
    assert result.verdict == "PASS", result.reason
    assert any(one.get("kind") == "fault" for one in log_of(folder))
    (said,) = [
        caveat
        for caveat in campaign_caveats([result])
        if caveat.startswith("judged by dead reckoning: ")
    ]
    assert "twin: the estimator has lost its absolute position (POS_HORIZ_ABS)" in said


@pytest.mark.parametrize(
    ("autopilot", "stage", "kind"),
    [
        ("px4", "identify", COMPANION),
        ("ardupilot", "goal", STATION),
        ("px4", "goal", GENERIC),
    ],
)
def test_a_foreign_heartbeat_is_named_and_is_no_state_of_the_vehicle(
    fly_run: Fly, autopilot: str, stage: Stage, kind: HeartbeatKind
) -> None:
    other = OtherSender(kind)

    def change(frame: MavlinkFrame, run_state: RunState) -> Iterable[bytes]:
        yield frame.raw
        if run_state.reached(stage):
            yield from other.beside(frame)

    result, folder = flown(fly_run, autopilot, change)
    assert other.sent
    assert result.verdict == "PASS", result.reason
    (event,) = [one for one in log_of(folder) if one.get("kind") == "other_sender"]
    assert f"(system 2, component 1): {kind}; " in event["text"]
    said = [caveat for caveat in campaign_caveats([result]) if f": {kind}" in caveat]
    assert len(said) == (stage == "identify")
    if said:
        assert event["t_s"] < next(
            one["t_s"] for one in log_of(folder) if one.get("stage") == "arm"
        )


@pytest.mark.parametrize("stage", ["identify", "goal"])
def test_second_board_behind_a_router_is_refused_or_ends_the_flight(
    fly_run: Fly, stage: Stage
) -> None:
    board = Board(PX4)

    def change(frame: MavlinkFrame, run_state: RunState) -> Iterable[bytes]:
        yield frame.raw
        if run_state.reached(stage):
            yield from board.beside(frame)

    result, folder = flown(fly_run, "px4", change)
    said = "two vehicles have the system id 2 on this link: two sequences of frames interleave"
    assert said in result.reason
    assert result.verdict == ("ERROR" if stage == "identify" else "INVALID")
    stages = [one.get("stage") for one in log_of(folder)]
    assert ("arm" in stages) == (stage == "goal")
    assert not any(one.get("kind") in {"disarmed", "reboot"} for one in log_of(folder)[:-5])
    assert all_landed(folder)


def test_second_board_behind_a_router_that_numbers_frames_anew_is_refused(fly_run: Fly) -> None:
    """Its frames cannot be told apart; positions by two clocks show it before arming."""
    board, router = Board(PX4), Router()

    def change(frame: MavlinkFrame, _: RunState) -> Iterable[bytes]:
        for raw in (frame.raw, *board.beside(frame)):
            yield from router.pass_on(raw)

    result, folder = flown(fly_run, "px4", change)
    assert result.verdict == "ERROR"
    assert "two vehicles have the system id 2 on this link: " in result.reason
    assert "by two clocks" in result.reason
    assert "arm" not in [one.get("stage") for one in log_of(folder)]
