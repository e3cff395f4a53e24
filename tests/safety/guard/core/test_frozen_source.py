"""A pose source that repeats its last pose with new times: the guard uses the estimate."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.safety.guard.guard_rigs import abort, make_pair
from wil_campaign.safety.guard.core.commands import AnchorAt
from wil_campaign.worlds.frames import Vec3

HERE: Vec3 = (0.0, 0.0, -2.0)
STANDING: Vec3 = (0.0, 0.0, 0.0)


def pose(pair: Any, position_m: Vec3, velocity_m_s: Vec3 = STANDING) -> None:
    """Have the orchestrator give a position of real."""
    pair.apply(pair.core.place("real", position_m, velocity_m_s, pair.t_s))


def estimated(pair: Any, position_m: Vec3, velocity_m_s: Vec3 = STANDING) -> None:
    """Have real send its own estimate."""
    message = mavlink.MAVLink_local_position_ned_message(0, *position_m, *velocity_m_s)
    frame = pair.vehicles["real"].codec.pack(message)
    pair.apply(pair.core.from_vehicle("real", frame, pair.t_s))


def anchored(pair: Any, north_m: float = 0.0) -> Any:
    """Return a pair whose real has an anchor, and of which nothing else gives positions."""
    pair.core.apply(AnchorAt("real", (north_m, 0.0, 0.0), 0.0), 0.0)
    pair.blind = ("real",)
    return pair


def fly(pair: Any, seconds: float, each: Callable[[float], None]) -> None:
    """Fly; call `each` 20 times a second with the time since the start."""
    since_s = pair.t_s
    pair.fly(seconds, each=lambda: each(pair.t_s - since_s))


def test_a_vehicle_that_leaves_the_fence_beside_a_frozen_source_is_stopped(pair: Any) -> None:
    anchored(pair)

    def each(t_s: float) -> None:
        pose(pair, HERE)
        if pair.core.latched is None:
            estimated(pair, (5.0 * t_s, 0.0, -2.0), (5.0, 0.0, 0.0))

    fly(pair, 1.0, each)
    assert pair.core.latched == "fence"
    (event,) = [one for one in pair.events if one.kind == "fence"]
    assert event.t_s <= 1.5, "0.3 s after an estimate stood beside the first of the equal poses"
    assert pair.kinds() == ["pose", "fence"]
    (event,) = [one for one in pair.events if one.kind == "pose"]
    assert event.vehicle == "real"
    assert "its pose source repeats one position while its own estimate moves" in event.text


def test_a_source_that_gives_new_positions_again_is_believed_again(pair: Any) -> None:
    anchored(pair)

    def each(t_s: float) -> None:
        frozen = t_s < 2.0
        pose(pair, HERE if frozen else (0.01 * t_s, 0.0, -2.0))
        # The estimate is outside of the fence when the source is believed again.
        estimated(pair, (min(0.4 * t_s, 0.8), 0.0, -2.0 if frozen else -20.0))

    fly(pair, 4.0, each)
    assert pair.core.latched is None
    assert pair.kinds() == ["pose"]


def test_equal_positions_of_a_staying_vehicle_are_no_sign_of_a_frozen_source(pair: Any) -> None:
    anchored(pair, north_m=9.0)  # where its estimate were believed, it would be outside

    def each(t_s: float) -> None:
        pose(pair, HERE)
        estimated(pair, (0.2 * math.sin(t_s), 0.0, -2.0))

    fly(pair, 60.0, each)
    assert pair.kinds() == []


def test_an_estimate_that_drifts_beside_a_live_source_is_not_believed(pair: Any) -> None:
    anchored(pair)

    def each(t_s: float) -> None:
        pose(pair, (0.001 * math.sin(t_s), 0.0, -2.0))
        estimated(pair, (0.3 * t_s, 0.0, -2.0), (0.3, 0.0, 0.0))

    fly(pair, 60.0, each)
    assert pair.kinds() == []


def test_a_few_equal_positions_while_the_estimate_jumps_are_chance(pair: Any) -> None:
    anchored(pair)

    def each(t_s: float) -> None:
        pose(pair, (0.001 * round(t_s * 4.0), 0.0, -2.0))  # coarse: each for a quarter of a second
        estimated(pair, (8.0 * (round(t_s + 0.1) % 2), 0.0, -2.0))

    fly(pair, 10.0, each)
    assert pair.kinds() == []


def test_a_standing_vehicle_may_have_an_estimate_that_wanders(fake_vehicle: Any, rig: Any) -> None:
    pair = anchored(make_pair(fake_vehicle, rig, real={"up_m": 0.0}))

    def each(t_s: float) -> None:
        pose(pair, STANDING)
        estimated(pair, (0.2 * t_s, 0.0, 0.0))

    fly(pair, 60.0, each)
    assert pair.kinds() == []


def reports(pair: Any, landed_state: int) -> None:
    """Have real report a MAV_LANDED_STATE: 1 on the ground, 3 taking off, 4 landing."""
    message = mavlink.MAVLink_extended_sys_state_message(0, landed_state)
    frame = pair.vehicles["real"].codec.pack(message)
    pair.apply(pair.core.from_vehicle("real", frame, pair.t_s))


def stood(fake_vehicle: Any, rig: Any) -> Any:
    """Return a pair whose real has reported to stand on the ground, and reports nothing more."""
    pair = anchored(make_pair(fake_vehicle, rig, real={"up_m": 0.0, "tells_landed": False}))
    reports(pair, 1)
    pose(pair, STANDING)
    estimated(pair, STANDING)
    return pair


@pytest.mark.parametrize("landed_state", [3, 4])
def test_a_standing_vehicle_that_reports_a_takeoff_or_landing_may_repeat_one_place(
    fake_vehicle: Any, rig: Any, landed_state: int
) -> None:
    """As PX4 1.16 in SIH: its estimate errs by half a metre, and its simulator stands still."""
    pair = stood(fake_vehicle, rig)
    reports(pair, landed_state)

    def each(t_s: float) -> None:
        pose(pair, STANDING)
        estimated(pair, (0.0, 0.8 if t_s > 1.0 else 0.0, -0.6), (0.0, 0.0, 0.0))

    fly(pair, 10.0, each)
    assert pair.kinds() == []


def test_a_source_that_repeats_the_ground_while_its_vehicle_climbs_is_frozen(
    fake_vehicle: Any, rig: Any
) -> None:
    pair = stood(fake_vehicle, rig)
    reports(pair, 3)

    def each(t_s: float) -> None:
        pose(pair, STANDING)
        if pair.core.latched is None:
            estimated(pair, (0.0, 0.0, -1.0 * t_s), (0.0, 0.0, -1.0))

    fly(pair, 7.0, each)
    assert pair.kinds() == ["pose", "fence"]
    assert next(event.t_s for event in pair.events if event.kind == "pose") < 3.0


def below(fake_vehicle: Any, rig: Any, *, rises_m: float = 0.0) -> list[str]:
    """Return what the guard does about a takeoff beside an estimate that sinks, floor at -1 m."""
    pair = stood(fake_vehicle, rig)
    reports(pair, 3)

    def each(t_s: float) -> None:
        up_m = rises_m * min(1.0, t_s) - 0.4 * max(0.0, t_s - 1.0)
        pose(pair, (0.001 * t_s, 0.0, -up_m), (0.0, 0.0, 0.4 if t_s > 1.0 else -rises_m))

    fly(pair, 4.0 + rises_m / 0.4, each)
    return [event.text for event in pair.events if event.kind == "fence"]


def test_the_floor_is_no_limit_for_a_vehicle_on_the_ground(fake_vehicle: Any, rig: Any) -> None:
    """It "cannot stop before the fence's floor", by an estimate that errs, while it spools up."""
    assert below(fake_vehicle, rig) == []
    (said,) = below(fake_vehicle, rig, rises_m=1.2)
    assert said.startswith("real cannot stop before the fence's floor")


def test_a_long_landing_beside_a_frozen_source_ends_on_the_ground(
    fake_vehicle: Any, rig: Any
) -> None:
    pair = anchored(make_pair(fake_vehicle, rig, attached=False))
    real = pair.vehicles["real"]
    real.up_m = 12.0
    abort(pair)

    def each(_: float) -> None:
        pose(pair, HERE)
        estimated(pair, (0.0, 0.0, -real.up_m))

    fly(pair, 40.0, each)
    assert "TERMINATE" not in real.words()
    assert pair.core.all_down
