"""The parts of the embedded autopilots' services: fences, commands, texts, files."""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from shapely.geometry import Point as ShapelyPoint
from shapely.geometry import Polygon as ShapelyPolygon

from wil_campaign.plugins.ardupilot.copter.parameter_file import parameter_file
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import EmulatedMissionItem
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import (
    ParameterTable,
    TableParameter,
)
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    marked_methods,
    on_command,
)
from wil_campaign.vehicles.embedded.autopilot.services.discovery import (
    ModeEntry,
    available_modes,
    current_mode,
)
from wil_campaign.vehicles.embedded.autopilot.services.fence_items import (
    EmulatedFence,
    emulated_fence,
)
from wil_campaign.vehicles.embedded.autopilot.services.outbox import Outbox
from wil_campaign.vehicles.embedded.autopilot.services.stream_intervals import StreamIntervals
from wil_campaign.vehicles.mavlink.fence_areas import FenceCircle, FencePolygon
from wil_campaign.worlds.geodesy import LocalFrame

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


def test_every_inclusion_and_every_exclusion_must_hold() -> None:
    west = FenceCircle((0.0, -4.0), 5.0, inside=True)
    east = FenceCircle((0.0, 4.0), 5.0, inside=True)
    hole = FenceCircle((0.0, 0.0), 0.2, inside=False)
    fence = EmulatedFence((west, east, hole))
    assert not fence.breached(0.0, 0.5)
    assert fence.breached(0.0, -4.0)
    assert fence.breached(0.0, 4.0)
    assert fence.breached(0.0, 0.0)
    assert not EmulatedFence().breached(1e6, 1e6)


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
        marked_methods(Child, "mav_commands")


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


def test_parameters_of_a_file_share_the_letters_of_the_name_before() -> None:
    table = (
        TableParameter("WP_SPEED", mavlink.MAV_PARAM_TYPE_REAL32, 1.5),
        TableParameter("WP_RADIUS", mavlink.MAV_PARAM_TYPE_INT16, -2.0),
        TableParameter("FRAME", mavlink.MAV_PARAM_TYPE_INT8, 1.0),
    )
    assert parameter_file(ParameterTable(table, bytewise=False)) == (
        bytes.fromhex("1b67 0300 0300")
        + (b"\x01\x40FRAME" + b"\x01")
        + (b"\x02\x80WP_RADIUS" + b"\xfe\xff")
        + (b"\x04\x43SPEED" + bytes.fromhex("0000c03f"))
    )


def test_a_mode_is_found_by_its_index_and_all_by_0() -> None:
    entries = (ModeEntry("Hold", 7, standard=2), ModeEntry("Ready", 9, 0, True, False))
    assert [each.mode_index for each in available_modes(entries, 0)] == [1, 2]
    (ready,) = available_modes(entries, 2)
    assert (ready.number_modes, ready.custom_mode, ready.properties) == (2, 9, 3)
    assert available_modes(entries, 3) == []
    assert current_mode(entries, 7).standard_mode == 2
    assert current_mode(entries, 8).standard_mode == 0


def test_a_fence_of_items_is_in_local_metres() -> None:
    frame = LocalFrame(47.0, 8.0, 500.0)
    north, east, radius_m = 10.0, -20.0, 5.0
    place = frame.to_geodetic((north, east, 0.0))
    item = EmulatedMissionItem(
        frame=mavlink.MAV_FRAME_GLOBAL,
        command=mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
        params=(radius_m, 0.0, 0.0, 0.0),
        x=round(place.latitude_deg * 1e7),
        y=round(place.longitude_deg * 1e7),
        z=0.0,
    )
    fence = emulated_fence([item], frame)
    assert fence.breached(north + radius_m - 0.1, east)
    assert not fence.breached(north + radius_m + 0.1, east)
