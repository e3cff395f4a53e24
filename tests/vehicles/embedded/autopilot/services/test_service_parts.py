"""The parts of the embedded autopilots' services: fences, streams, commands, texts."""

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely.geometry import Point as ShapelyPoint
from shapely.geometry import Polygon as ShapelyPolygon

from vehicles.embedded.autopilot.services.command_registry import marked, on_command
from vehicles.embedded.autopilot.services.fence_items import EmulatedFence
from vehicles.embedded.autopilot.services.outbox import Outbox
from vehicles.embedded.autopilot.services.stream_intervals import StreamIntervals
from vehicles.mavlink.fence_areas import FenceCircle, FencePolygon

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
