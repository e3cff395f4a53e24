"""Setpoints are held to their limits: properties of the limiter, and frames through the core."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.safety.guard.guard_rigs import DRIVER
from wil_campaign.plugins.ardupilot.strategy import ArduCopter
from wil_campaign.safety.fence.areas import Circle
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.stopping import VehicleMotion
from wil_campaign.safety.guard.core.commands import AnchorAt
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardEvent, ToVehicle
from wil_campaign.safety.guard.core.guard_core import GuardCore
from wil_campaign.safety.guard.core.setpoint_frames import read_setpoint, rewritten_setpoint_frame
from wil_campaign.safety.guard.core.setpoint_limiter import SetpointLimiter
from wil_campaign.safety.guard.core.setpoint_limits import SetpointLimits
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, MavlinkTarget
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import FrameSplitter, MavlinkFrame, frame_header
from wil_campaign.vehicles.poses.anchor import Anchor
from wil_campaign.vehicles.setpoints import PositionSetpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Pose, Vec3, norm, subtract

FENCE = Fence.box(north_m=(-3, 5), east_m=(-3, 3), up_m=(0, 4))
LATENCY_S, BRAKING_M_S2 = 0.5, 2.5
STANDING: Vec3 = (0.0, 0.0, 0.0)
AT = VehicleMotion((0.0, 0.0, -2.0), STANDING)


def limiter(**limits: Any) -> SetpointLimiter:
    return SetpointLimiter(
        limits=SetpointLimits(**limits),
        fence=FENCE,
        latency_s=LATENCY_S,
        braking_m_s2=BRAKING_M_S2,
    )


def velocity_after(made: SetpointLimiter, asked: Vec3, motion: VehicleMotion | None = AT) -> Vec3:
    given_, _ = made.limit(VelocitySetpoint(asked), motion, 0.0)
    assert isinstance(given_, VelocitySetpoint)
    return given_.velocity_ned_m_s


def position_after(made: SetpointLimiter, asked: Vec3, motion: VehicleMotion | None = AT) -> Vec3:
    given_, _ = made.limit(PositionSetpoint(asked), motion, 0.0)
    assert isinstance(given_, PositionSetpoint)
    return given_.position_ned_m


component = st.floats(-20.0, 20.0)
vectors = st.tuples(component, component, component)
inside = st.tuples(st.floats(-2.6, 4.6), st.floats(-2.6, 2.6), st.floats(-3.6, -0.4))


@given(vectors)
def test_a_setpoint_within_the_limits_is_not_changed(asked: Vec3) -> None:
    made = limiter(speed_m_s=40.0, acceleration_m_s2=1000.0, floor_up_m=-500, ceiling_up_m=500)
    setpoint = VelocitySetpoint(asked, yaw_rad=0.3)
    assert made.limit(setpoint, AT, 0.0) == (setpoint, ())


@given(vectors, st.floats(0.1, 5.0))
def test_speed_is_cut_and_its_direction_kept(asked: Vec3, limit_m_s: float) -> None:
    got = velocity_after(limiter(speed_m_s=limit_m_s), asked)
    assert norm(got) <= limit_m_s + 2e-3
    for axis in range(3):
        assert got[axis] * norm(asked) == pytest.approx(asked[axis] * norm(got), abs=1e-6)


@given(st.lists(st.tuples(vectors, st.floats(0.01, 0.4)), min_size=2, max_size=20))
def test_setpoints_change_no_faster_than_the_acceleration_limit(
    steps: list[tuple[Vec3, float]],
) -> None:
    made, t_s = limiter(acceleration_m_s2=2.0), 0.0
    before: Vec3 | None = None
    for asked, after_s in steps:
        t_s += after_s
        got, _ = made.limit(VelocitySetpoint(asked), AT, t_s)
        assert isinstance(got, VelocitySetpoint)
        if before is not None:
            changed = norm(subtract(got.velocity_ned_m_s, before))
            assert changed <= 2.0 * after_s + 2e-3
        before = got.velocity_ned_m_s


def test_after_a_pause_the_vehicle_s_own_motion_is_where_it_starts_from() -> None:
    made = limiter(acceleration_m_s2=2.0)
    moving = VehicleMotion((0.0, 0.0, -2.0), (3.0, 0.0, 0.0))
    got, found = made.limit(VelocitySetpoint((3.5, 0.0, 0.0)), moving, 10.0)
    assert (got, found) == (VelocitySetpoint((3.5, 0.0, 0.0)), ())


@given(inside, vectors)
def test_a_vehicle_can_stop_before_the_fence_from_any_limited_setpoint(
    place: Vec3, asked: Vec3
) -> None:
    got = velocity_after(limiter(inside_fence=True), asked, VehicleMotion(place, STANDING))
    breach = FENCE.breached(
        VehicleMotion(place, got), latency_s=LATENCY_S, braking_m_s2=BRAKING_M_S2
    )
    assert breach is None


def test_a_vehicle_too_close_to_the_fence_may_go_back_and_no_closer() -> None:
    made, close = limiter(inside_fence=True), VehicleMotion((4.9, 0.0, -2.0), STANDING)
    assert velocity_after(made, (0.5, 0.0, 0.0), close) == STANDING
    assert velocity_after(made, (-0.5, 0.0, 0.0), close) == (-0.5, 0.0, 0.0)
    outside = VehicleMotion((6.0, 0.0, -2.0), STANDING)
    assert velocity_after(made, (-0.5, 0.0, 0.0), outside) == (-0.5, 0.0, 0.0)
    assert position_after(made, (0.0, 0.0, -2.0), outside) == (0.0, 0.0, -2.0)
    assert position_after(made, (9.0, 0.0, -2.0), outside) == pytest.approx((6.0, 0.0, -2.0))


@given(inside, vectors)
def test_heights_are_kept_as_well(place: Vec3, asked: Vec3) -> None:
    made = limiter(floor_up_m=0.0, ceiling_up_m=4.0, keep_m=0.3)
    got = velocity_after(made, asked, VehicleMotion(place, STANDING))
    assert got[:2] == asked[:2]
    climb, up_m = -got[2], -place[2]
    stops_m = up_m + climb * LATENCY_S + math.copysign(climb * climb / (2 * BRAKING_M_S2), climb)
    assert 0.3 - 1e-2 <= stops_m <= 3.7 + 1e-2


@given(inside, vectors)
def test_a_way_ends_before_the_fence(place: Vec3, target: Vec3) -> None:
    got = position_after(limiter(inside_fence=True), target, VehicleMotion(place, STANDING))
    assert FENCE.margin_m(got) >= 0.3 - 0.02 or got == pytest.approx(place)


def test_a_way_through_an_exclusion_ends_before_it() -> None:
    fence = Fence(exclusions=[Circle((5.0, 0.0), 1.0)], floor_up_m=0.0)
    made = SetpointLimiter(
        limits=SetpointLimits(inside_fence=True), fence=fence, latency_s=0.5, braking_m_s2=2.5
    )
    given_, found = made.limit(PositionSetpoint((10.0, 0.0, -2.0)), AT, 0.0)
    assert isinstance(given_, PositionSetpoint)
    assert 3.69 < given_.position_ned_m[0] < 3.71
    assert [one.what for one in found] == ["path towards the fence"]


def test_a_far_position_is_drawn_near_by_the_speed_limit() -> None:
    assert position_after(limiter(speed_m_s=0.8), (3.0, 0.0, -2.0)) == pytest.approx(
        (0.8, 0.0, -2.0)
    )


def test_no_motion_that_a_place_would_limit_passes_at_an_unknown_place() -> None:
    made = limiter(inside_fence=True, ceiling_up_m=3.0)
    assert velocity_after(made, (1.0, 0.0, 0.0), None) == STANDING
    assert velocity_after(limiter(ceiling_up_m=3.0), (1.0, 0.0, -1.0), None) == (1.0, 0.0, 0.0)
    assert made.limit(PositionSetpoint(STANDING), None, 0.0)[0] is None
    assert position_after(limiter(ceiling_up_m=3.3), (0.0, 0.0, -9.0), None) == (0.0, 0.0, -3.0)


# frames


def frame_of(raw: bytes) -> MavlinkFrame:
    frame = frame_header(raw)
    assert frame is not None
    return frame


def velocity_frame(autopilot: Autopilot, asked: Vec3, **heading: float) -> bytes:
    message = autopilot.velocity_setpoint(
        MavlinkTarget(1), t_boot_ms=4711, velocity_ned_m_s=asked, **heading
    )
    return DRIVER.pack(message)


ANCHOR = Anchor((1.0, 2.0, -0.5), math.radians(30.0))


@pytest.mark.parametrize("autopilot", [Px4(), ArduCopter()])
@pytest.mark.parametrize("heading", [{}, {"yaw_rad": 0.4}, {"yaw_rate_rad_s": 0.2}])
def test_a_frame_written_anew_differs_only_in_its_velocity(
    autopilot: Autopilot, heading: dict[str, float]
) -> None:
    raw = velocity_frame(autopilot, (2.0, 1.0, 0.0), **heading)
    frame = frame_of(raw)
    asked = read_setpoint(frame, ANCHOR)
    assert isinstance(asked, VelocitySetpoint)
    world = ANCHOR.velocity((2.0, 1.0, 0.0))
    assert asked.velocity_ned_m_s == pytest.approx(world)
    north, east, down = asked.velocity_ned_m_s
    half = replace(asked, velocity_ned_m_s=(north / 2.0, east / 2.0, down / 2.0))
    again = rewritten_setpoint_frame(frame, half, ANCHOR)
    (checked,) = FrameSplitter().feed(again)
    assert (checked.seq, checked.system, checked.component) == (frame.seq, 245, 190)
    reader = MavlinkCodec(system_id=1, component_id=1)
    (old,), (new,) = reader.parse(raw), reader.parse(again)
    changed = {
        name
        for name in old.get_fieldnames()
        if getattr(old, name) != pytest.approx(getattr(new, name), abs=1e-6)
    }
    assert changed == {"vx", "vy"}
    assert (new.vx, new.vy) == (pytest.approx(1.0), pytest.approx(0.5))


@pytest.mark.parametrize("version", [1, 2])
def test_positions_in_both_versions_of_mavlink(version: int) -> None:
    message = Px4().position_setpoint(
        MavlinkTarget(1), t_boot_ms=1, position_ned_m=(3.0, 0.0, -1.0)
    )
    mav = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    raw = bytes(message.pack(mav, force_mavlink1=version == 1))
    frame = frame_of(raw)
    assert frame.version == version
    again = rewritten_setpoint_frame(frame, PositionSetpoint((1.0, 0.0, -1.0)), None)
    (checked,) = FrameSplitter().feed(again)
    assert read_setpoint(checked, None) == PositionSetpoint((1.0, 0.0, -1.0))


def local(mask: int, frame: int = 1, **fields: float) -> bytes:
    names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
    values = [fields.get(name, 0.0) for name in names]
    return DRIVER.pack(
        mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *values)
    )


def test_a_heading_beside_a_turn_rate_is_the_heading() -> None:
    """The rate counts where no heading is given."""
    given = {"vx": 1.0, "yaw": 0.5, "yaw_rate": 0.25}  # exact as floats of 32 bits
    both = read_setpoint(frame_of(local(0b000111000111, 1, **given)), None)
    assert both == VelocitySetpoint((1.0, 0.0, 0.0), 0.5, None)
    rate = read_setpoint(frame_of(local(0b010111000111, 1, **given)), None)
    assert rate == VelocitySetpoint((1.0, 0.0, 0.0), None, 0.25)


@pytest.mark.parametrize(
    "raw",
    [
        local(0b110000111000, 1),  # an acceleration
        local(0b111111000111, 8),  # a velocity along the body
        local(0b110111100011, 1),  # a height and a horizontal velocity
        local(0b110111000111, 1, vx=math.nan),
        local(0b110111111000, 1, z=math.inf),
        DRIVER.pack(
            mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1.0, 0, 0, 0], 0, 0, 0, 0.5)
        ),
    ],
)
def test_a_setpoint_that_cannot_be_limited_is_not_passed(raw: bytes) -> None:
    assert read_setpoint(frame_of(raw), None) is None
    core = make_core(speed_m_s=1.0)
    (event,) = core.from_orchestrator("real", raw, 0.0)
    assert isinstance(event, GuardEvent)
    assert event.kind == "limited"
    assert event.text.endswith("is not forwarded")


def test_a_position_that_may_lead_anywhere_is_reported_and_not_passed() -> None:
    core = make_core(speed_m_s=1.0)  # and nobody knows where the vehicle is
    (event,) = core.from_orchestrator("real", local(0b110111111000, 1, x=3.0), 0.0)
    assert isinstance(event, GuardEvent)
    assert event.text == "real: a position setpoint at an unknown position is not forwarded"


def make_core(**limits: Any) -> GuardCore:
    vehicle = GuardedVehicle(
        autopilot=Px4(), target=MavlinkTarget(1), fence=FENCE, limits=SetpointLimits(**limits)
    )
    return GuardCore(vehicles={"real": vehicle})


def passed(core: GuardCore, raw: bytes, t_s: float) -> list[float]:
    """Return the norths of the velocities that pass."""
    reader = MavlinkCodec(system_id=1, component_id=1)
    frames = [
        f
        for o in core.from_orchestrator("real", raw, t_s)
        if isinstance(o, ToVehicle)
        for f in o.frames
    ]
    return [message.vx for frame in frames for message in reader.parse(frame)]


def test_each_spell_of_limiting_is_reported_at_its_begin_and_end() -> None:
    core = make_core(speed_m_s=1.0)
    events: list[GuardEvent] = []
    for step in range(60):
        t_s = step * 0.05
        if step < 20:
            asked = 2.0 + 0.1 * step
            outputs = core.from_orchestrator("real", velocity_frame(Px4(), (asked, 0.0, 0.0)), t_s)
            events += [output for output in outputs if isinstance(output, GuardEvent)]
        events += [one for one in core.tick(t_s) if isinstance(one, GuardEvent)]
    assert [(event.kind, event.vehicle, event.text) for event in events] == [
        ("limited", "real", "real: speed limited from 2.00 to 1.00 m/s"),
        (
            "limited",
            "real",
            "real: speed limited from 3.90 to 1.00 m/s: 20 times, this the worst",
        ),
    ]


def test_the_anchor_says_where_the_vehicle_s_north_is() -> None:
    core = make_core(inside_fence=True)
    core.apply(AnchorAt("real", (0.0, 0.0, 0.0), math.pi), 0.0)
    core.position(PoseSample(0.0, "real", Pose((4.0, 0.0, -2.0)), STANDING))
    towards, away = (velocity_frame(Px4(), (v, 0.0, 0.0)) for v in (-3.0, 2.0))
    (north,) = passed(core, towards, 0.1)
    assert -0.44 < north < -0.42
    assert passed(core, away, 0.2) == [pytest.approx(2.0)]


def test_without_limits_every_byte_passes_as_it_came() -> None:
    core = GuardCore(vehicles={"real": GuardedVehicle(autopilot=Px4(), target=MavlinkTarget(1))})
    raw = velocity_frame(Px4(), (99.0, 0.0, 0.0))
    assert core.from_orchestrator("real", raw, 0.0) == (ToVehicle("real", (raw,)),)


@pytest.mark.parametrize("speed_m_s", [2.0, math.nextafter(2.0, 0.0)])
def test_a_speed_at_its_limit_is_not_limited(speed_m_s: float) -> None:
    asked = VelocitySetpoint((0.0, -speed_m_s, 0.0), yaw_rad=0.3)
    assert limiter(speed_m_s=2.0).limit(asked, AT, 0.0) == (asked, ())


def test_a_speed_above_its_limit_is_limited_and_reported() -> None:
    got, (limiting,) = limiter(speed_m_s=2.0).limit(VelocitySetpoint((0.0, 2.01, 0.0)), AT, 0.0)
    assert isinstance(got, VelocitySetpoint)
    assert got.velocity_ned_m_s == pytest.approx((0.0, 2.0, 0.0))
    assert (limiting.what, limiting.given) == ("speed", 2.0)


def test_a_position_that_is_impossibly_far_away_does_not_stop_the_guard() -> None:
    """Where a fence has no sides, a setpoint of 1e9 m kept the guard busy for minutes."""
    made = SetpointLimiter(
        limits=SetpointLimits(inside_fence=True),
        fence=Fence(exclusions=(Circle((0, 50), 5),), floor_up_m=0, ceiling_up_m=4),
        latency_s=LATENCY_S,
        braking_m_s2=BRAKING_M_S2,
    )
    north_m, east_m, down_m = position_after(made, (1e9, 0.0, -2.0))
    assert 10.0 < north_m < 1e4
    assert (east_m, down_m) == (0.0, -2.0)


def test_a_path_along_a_boundary_is_cut_and_leads_not_out() -> None:
    made = SetpointLimiter(
        limits=SetpointLimits(inside_fence=True, keep_m=1.0),
        fence=Fence(floor_up_m=-0.5, ceiling_up_m=5.0),
        latency_s=LATENCY_S,
        braking_m_s2=BRAKING_M_S2,
    )
    along = PositionSetpoint((40.0, 0.0, -4.0))
    given_, (report,) = made.limit(along, VehicleMotion((0.0, 0.0, -4.0), (0.0, 0.0, 0.0)), 0.0)
    assert isinstance(given_, PositionSetpoint)
    assert given_.position_ned_m[0] == pytest.approx(10.0, abs=0.1)
    assert report.what == "distance ahead"
