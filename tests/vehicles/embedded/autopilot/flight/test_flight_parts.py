"""The parts of the embedded autopilots' flight: parameters, setpoints, landing speeds."""

import math
import struct

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.at_rest import AT_REST
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import (
    FollowBehaviour,
    GoToBehaviour,
    GuidanceBehaviour,
    GuidanceSpeeds,
    HoldBehaviour,
    LandProfile,
    TakeOffBehaviour,
    WantedMotion,
)
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import (
    ParameterTable,
    TableParameter,
)
from wil_campaign.vehicles.embedded.autopilot.flight.setpoint_targets import local_setpoint

finite = st.floats(-100.0, 100.0)


@given(st.integers(-(2**31), 2**31 - 1))
def test_bytewise_integers_survive_the_wire(number: int) -> None:
    bits = struct.pack("<i", number)
    # A signalling NaN is quietened by the processor: that is so on every autopilot's link too.
    assume(not (bits[3] & 0x7F == 0x7F and 0x80 <= bits[2] < 0xC0))
    table = ParameterTable((TableParameter("A", mavlink.MAV_PARAM_TYPE_INT32, 0.0),), bytewise=True)
    table.set("A", number)
    assert table.from_wire(mavlink.MAV_PARAM_TYPE_INT32, table.to_wire("A")) == number


@given(st.integers(-(2**24), 2**24))
def test_cast_integers_survive_the_wire(number: int) -> None:
    table = ParameterTable(
        (TableParameter("A", mavlink.MAV_PARAM_TYPE_INT32, 0.0),), bytewise=False
    )
    table.set("A", number)
    assert table.to_wire("A") == number
    assert table.from_wire(mavlink.MAV_PARAM_TYPE_INT32, table.to_wire("A")) == number


@given(yaw=st.floats(-3.0, 3.0), vector=st.tuples(finite, finite, finite))
def test_body_setpoints_turn_with_the_heading(
    yaw: float, vector: tuple[float, float, float]
) -> None:
    now = AT_REST._replace(position_ned_m=(1.0, 2.0, 3.0), euler_rad=(0.1, -0.2, yaw))
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, mavlink.MAV_FRAME_BODY_OFFSET_NED, 0b0000_1101_1111_1000, *vector, *(0.0,) * 8
    )
    wanted = local_setpoint(message, now)
    assert wanted is not None
    north, east, down = wanted.position_ned_m
    assert north == pytest.approx(1.0 + vector[0] * math.cos(yaw) - vector[1] * math.sin(yaw))
    assert east == pytest.approx(2.0 + vector[0] * math.sin(yaw) + vector[1] * math.cos(yaw))
    assert down == pytest.approx(3.0 + vector[2])
    assert wanted.yaw_rad is None


def test_a_message_that_asks_for_nothing_is_no_setpoint() -> None:
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0b1111_1111_1111, *(0.0,) * 11
    )
    assert local_setpoint(message, AT_REST) is None
    message.type_mask = 0b1111_1111_1000
    message.x = message.y = message.z = math.nan
    assert local_setpoint(message, AT_REST) is None


@given(st.floats(-5.0, 40.0))
def test_landing_speeds_lie_between_their_steps(height_m: float) -> None:
    profile = LandProfile(((10.0, 1.5), (5.0, 0.7), (1.0, 0.7), (1.0, 0.3)))
    assert 0.3 <= profile.speed(height_m) <= 1.5
    if height_m < 1.0:
        assert profile.speed(height_m) == 0.3
    if height_m > 10.0:
        assert profile.speed(height_m) == 1.5
    if 1.0 < height_m < 5.0:
        assert profile.speed(height_m) == pytest.approx(0.7)


_SPEEDS = GuidanceSpeeds(5.0, 3.0, 1.5)
_STEADY = {
    "hold": HoldBehaviour(speeds=_SPEEDS, yaw_rad=0.1),
    "hold there": HoldBehaviour(speeds=_SPEEDS, yaw_rad=0.1, position_ned_m=(1.0, 2.0, 3.0)),
    "go to": GoToBehaviour(
        position_ned_m=(0.0, 0.0, 0.0), yaw_rad=0.1, speeds=_SPEEDS, radius_m=1.0
    ),
    "follow": FollowBehaviour(speeds=_SPEEDS, yaw_rad=0.1, may_lift=False),
}


@pytest.mark.parametrize("behaviour", _STEADY.values(), ids=_STEADY)
def test_a_steady_target_is_what_the_behaviour_returns_wherever_it_is(
    behaviour: GuidanceBehaviour,
) -> None:
    fast = AT_REST._replace(velocity_ned_m_s=(2.0, 0.0, 0.0), position_ned_m=(9.0, 0.0, 0.0))
    for now in (fast, AT_REST, fast, AT_REST._replace(position_ned_m=(0.1, 0.2, 0.3))):
        steady = behaviour.steady
        target = behaviour.update(now, 1.0)
        assert steady in {None, target}
        assert behaviour.done is (behaviour.steady is target) or isinstance(
            behaviour, FollowBehaviour
        )
    assert behaviour.steady is behaviour.update(fast, 2.0)
    behaviour.face(1.0)
    assert behaviour.steady is behaviour.update(AT_REST, 3.0)


def test_a_takeoff_is_steady_once_it_has_arrived_at_its_whole_speed() -> None:
    takeoff = TakeOffBehaviour(down_m=-2.0, climb_m_s=1.5, ramp_s=3.0, radius_m=0.3, speeds=_SPEEDS)
    above = AT_REST._replace(position_ned_m=(0.0, 0.0, -1.9))
    climbs = [takeoff.update(AT_REST, t_s).speed_m_s[1] for t_s in (1.0, 2.5, 9.0)]
    assert climbs == pytest.approx([0.15, 0.9, 1.5])
    assert takeoff.steady is None
    assert takeoff.update(above, 9.1) is takeoff.update(AT_REST, 9.2) is takeoff.steady
    early = TakeOffBehaviour(down_m=-2.0, climb_m_s=1.5, ramp_s=3.0, radius_m=0.3, speeds=_SPEEDS)
    early.update(above, 1.0)
    assert early.done
    assert early.steady is None


def test_a_velocity_that_may_be_limited_is_not_steady() -> None:
    follow = FollowBehaviour(
        speeds=_SPEEDS, yaw_rad=0.0, may_lift=False, limit=lambda velocity, _yaw, _t: velocity
    )
    assert follow.steady is None
    wanted = WantedMotion((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), None, 0.0, has_velocity=False)
    follow.set(wanted, keep_yaw_rad=0.0)
    assert follow.steady is follow.update(AT_REST, 0.0)
