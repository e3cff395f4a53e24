"""The order of modes, arming, takeoff and landing: as in the reference traces, and otherwise."""

import json
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.step_response.event_order import (
    EventOccurrence,
    EventTrace,
    OrderRow,
    order_rows,
)
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

TRACES = Path(__file__).parents[2] / "vehicles" / "traces"
AS_FLOWN = [
    EventOccurrence(0.0, "disarmed"),
    EventOccurrence(0.0, "hold"),
    EventOccurrence(0.1, "on the ground"),
    EventOccurrence(1.0, "acknowledged", mavlink.MAV_CMD_COMPONENT_ARM_DISARM),
    EventOccurrence(1.1, "armed"),
    EventOccurrence(1.2, "acknowledged", mavlink.MAV_CMD_NAV_TAKEOFF),
    EventOccurrence(1.3, "takeoff"),
    EventOccurrence(3.0, "taking off"),
    EventOccurrence(9.0, "hold"),
    EventOccurrence(9.0, "in the air"),
    EventOccurrence(12.0, "acknowledged", mavlink.MAV_CMD_DO_SET_MODE),
    EventOccurrence(12.0, "guided"),
    EventOccurrence(20.0, "acknowledged", mavlink.MAV_CMD_DO_SET_MODE),
    EventOccurrence(20.1, "land"),
    EventOccurrence(20.1, "landing"),
    EventOccurrence(30.0, "on the ground"),
    EventOccurrence(32.0, "disarmed"),
]


def beyond(events: list[EventOccurrence], autopilot: str = "px4") -> dict[str, OrderRow]:
    return {row.name: row for row in order_rows(events, autopilot) if row.beyond}


def test_a_flight_in_the_firmware_s_order_is_as_the_firmware() -> None:
    assert beyond(AS_FLOWN) == {}


@pytest.mark.parametrize(
    ("place", "moved", "names"),
    [
        (4, EventOccurrence(0.9, "armed"), {"arming"}),
        (13, EventOccurrence(19.0, "land"), {"land"}),
        (14, EventOccurrence(20.1, "in the air"), {"landed states"}),
        (8, EventOccurrence(9.0, "takeoff"), {"modes"}),
        (12, EventOccurrence(12.0, "rtl"), {"modes"}),
        (16, EventOccurrence(32.0, "hold"), {"modes", "end"}),
    ],
)
def test_another_order_is_seen(place: int, moved: EventOccurrence, names: set[str]) -> None:
    events = [*AS_FLOWN[:place], moved, *AS_FLOWN[place + 1 :]]
    assert set(beyond(events)) == names


def test_an_event_that_never_happened_is_missing() -> None:
    row = beyond(AS_FLOWN[:3])["arming"]
    assert (row.firmware, row.flown) == (("acknowledged", "armed"), ())


def test_disarming_before_the_ground_is_seen() -> None:
    events = [*AS_FLOWN[:-2], AS_FLOWN[-1], AS_FLOWN[-2]]
    assert beyond(events)["end"].flown == ("disarmed", "on the ground")


@pytest.mark.parametrize(
    ("autopilot", "file"),
    [("px4", "px4-1.18-offboard.json"), ("ardupilot", "arducopter-4.7-guided.json")],
)
def test_the_firmware_s_own_trace_has_the_order_that_is_expected(autopilot: str, file: str) -> None:
    trace = EventTrace(autopilot=autopilot_named(autopilot), target=MavlinkTarget(1))
    golden = json.loads((TRACES / file).read_text("utf-8"))
    for _, _, base_mode, custom_mode, status in golden["modes"]:
        trace.receive_message(
            mavlink.MAVLink_heartbeat_message(2, 3, base_mode, custom_mode, status, 3), 0.0
        )
    for _, _, state in golden["landed"]:
        trace.receive_message(mavlink.MAVLink_extended_sys_state_message(0, state), 0.0)
    rows = {row.name: row for row in order_rows(trace.events, autopilot)}
    assert not rows["landed states"].beyond
    seen = [mode for mode in rows["modes"].flown if mode != "rtl"]  # its failsafe was tried
    assert tuple(seen) == rows["modes"].firmware


def test_messages_of_others_on_the_link_are_no_events() -> None:
    trace = EventTrace(autopilot=autopilot_named("px4"), target=MavlinkTarget(1))
    heartbeat = mavlink.MAVLink_heartbeat_message(6, 8, 128, 0, 4, 3)
    trace.receive(MavlinkCodec(system_id=255, component_id=190).pack(heartbeat), 0.0)
    assert trace.events == []
    trace.receive(MavlinkCodec(system_id=1, component_id=1).pack(heartbeat), 0.0)
    assert [event.name for event in trace.events] == ["armed", "other"]
