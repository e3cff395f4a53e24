"""The autopilots' parts by themselves: values in, values out."""

import math
import struct

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from shapely.geometry import Point as ShapelyPoint
from shapely.geometry import Polygon as ShapelyPolygon

from vehicles.embedded.autopilot.flight.guidance import LandProfile
from vehicles.embedded.autopilot.flight.parameter_table import Parameter, Parameters
from vehicles.embedded.autopilot.flight.setpoint_targets import local_setpoint
from vehicles.embedded.autopilot.px4.px4_modes import Px4Mode, px4_mode
from vehicles.embedded.autopilot.services.command_registry import marked, on_command
from vehicles.embedded.autopilot.services.fence_items import EmulatedFence
from vehicles.embedded.autopilot.services.outbox import Outbox
from vehicles.embedded.autopilot.services.stream_intervals import StreamIntervals
from vehicles.embedded.physics.states import AT_REST
from vehicles.mavlink.fence_areas import FenceCircle, FencePolygon

finite = st.floats(-100.0, 100.0)


# The autopilots' parts.


@given(st.integers(-(2**31), 2**31 - 1))
def test_bytewise_integers_survive_the_wire(number: int) -> None:
    bits = struct.pack("<i", number)
    # A signalling NaN is quietened by the processor: that is so on every autopilot's link too.
    assume(not (bits[3] & 0x7F == 0x7F and 0x80 <= bits[2] < 0xC0))
    table = Parameters((Parameter("A", mavlink.MAV_PARAM_TYPE_INT32, 0.0),), bytewise=True)
    table.set("A", number)
    assert table.from_wire(mavlink.MAV_PARAM_TYPE_INT32, table.to_wire("A")) == number


@given(st.integers(-(2**24), 2**24))
def test_cast_integers_survive_the_wire(number: int) -> None:
    table = Parameters((Parameter("A", mavlink.MAV_PARAM_TYPE_INT32, 0.0),), bytewise=False)
    table.set("A", number)
    assert table.to_wire("A") == number
    assert table.from_wire(mavlink.MAV_PARAM_TYPE_INT32, table.to_wire("A")) == number


coordinate = st.integers(-50, 50).map(float)


@given(
    corners=st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=8, unique=True),
    point=st.tuples(st.floats(-60, 60), st.floats(-60, 60)),
)
def test_polygon_fences_agree_with_shapely(
    corners: list[tuple[float, float]], point: tuple[float, float]
) -> None:
    shape = ShapelyPolygon(corners)
    assume(shape.is_valid)
    assume(shape.boundary.distance(ShapelyPoint(point)) > 1e-6)
    inside = shape.contains(ShapelyPoint(point))
    assert (
        EmulatedFence((FencePolygon(tuple(corners), inside=True),)).breached(*point) is not inside
    )
    assert EmulatedFence((FencePolygon(tuple(corners), inside=False),)).breached(*point) is inside


def test_one_inclusion_must_hold_and_every_exclusion() -> None:
    west = FenceCircle((0.0, -10.0), 5.0, inside=True)
    east = FenceCircle((0.0, 10.0), 5.0, inside=True)
    hole = FenceCircle((0.0, 10.0), 1.0, inside=False)
    fence = EmulatedFence((west, east, hole))
    assert not fence.breached(0.0, -10.0)
    assert not fence.breached(0.0, 7.0)
    assert fence.breached(0.0, 10.0)
    assert fence.breached(0.0, 0.0)
    assert not EmulatedFence().breached(1e6, 1e6)


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


def test_setpoints_of_nothing_are_none() -> None:
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0b1111_1111_1111, *(0.0,) * 11
    )
    assert local_setpoint(message, AT_REST) is None
    message.type_mask = 0b1111_1111_1000
    message.x = message.y = message.z = math.nan
    assert local_setpoint(message, AT_REST) is None


def test_streams_keep_their_rates_on_a_coarse_clock() -> None:
    streams = StreamIntervals({1: 10.0, 2: 3.0}, shortest_s=0.004)
    counts = {1: 0, 2: 0}
    for step in range(1, 2501):
        for message_id in streams.due(step * 0.004):
            counts[message_id] += 1
    # Both ends of the ten seconds.
    assert counts == {1: 101, 2: 31}
    streams.set_rate(1, 0.0, now_s=10.0)
    assert 1 not in streams.due(11.0)
    streams.set_rate(3, 1e9, now_s=10.0)
    assert streams.interval_s(3) == 0.004


def test_a_command_has_one_owner() -> None:
    class Twice:
        @on_command(5)
        def a(self) -> None: ...

        @on_command(5)
        def b(self) -> None: ...

    class Child(Twice):
        pass

    with pytest.raises(ValueError, match="handles 5 twice"):
        marked(Child, "mav_commands")


def test_long_texts_are_cut_into_chunks() -> None:
    px4, copter = Outbox(count_all=True), Outbox(count_all=False)
    for box in (px4, copter):
        box.send_text(6, "short")
        box.send_text(6, "x" * 120)
        box.turn(send_texts=False)
        assert box.take() == []
        box.send_text(6, "short")
        box.send_text(6, "x" * 120)
        box.turn(send_texts=True)
    assert [(m.id, m.chunk_seq) for m in px4.take()] == [(0, 0), (1, 0), (1, 1), (1, 2)]
    assert [(m.id, m.chunk_seq) for m in copter.take()] == [(0, 0), (1, 0), (1, 1), (1, 2)]


@pytest.mark.parametrize("mode", list(Px4Mode))
def test_px4_modes_are_found_by_their_numbers(mode: Px4Mode) -> None:
    assert px4_mode(mode.custom_mode >> 16 & 0xFF, mode.custom_mode >> 24) is mode


def test_unknown_px4_modes_are_none() -> None:
    assert px4_mode(4, 0) is None
    assert px4_mode(99, 0) is None


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
