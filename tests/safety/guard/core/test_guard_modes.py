from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.safety.guard.guard_rigs import (
    DRIVER,
    abort,
    command,
    make_pair,
    mode_command,
    to_orchestrator,
)
from tests.vehicles.px4_modes import px4_custom_mode
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.vehicles.autopilots.autopilot import FlightMode


def test_a_pilot_takes_over_and_the_guard_keeps_out(pair: Any) -> None:
    real = pair.vehicles["real"]
    real.mode = FlightMode.PILOT
    pair.fly(1.1)
    assert pair.core.latched == "takeover"
    heard_before = len(real.heard)
    pair.fly(20.0)
    assert {word for _, word in real.heard[heard_before:]} == {"HEARTBEAT"}
    assert len(real.heard) - heard_before == 20
    assert not pair.vehicles["twin"].armed
    assert to_orchestrator(pair, "real", mode_command(FlightMode.GUIDED)) == ()
    param = DRIVER.pack(mavlink.MAVLink_param_set_message(1, 1, b"RTL_ALT", 5.0, 9))
    assert to_orchestrator(pair, "real", param) == ()
    assert pair.core.phases["real"] is ContingencyPhase.PILOT
    real.armed = False
    pair.fly(2.6)
    assert pair.core.all_down
    # What the run changed is restored once the pilot has landed, unless the pilot starts again.
    assert to_orchestrator(pair, "real", param) == (param,)
    assert to_orchestrator(pair, "real", mode_command(FlightMode.GUIDED)) == ()
    real.armed = True
    pair.fly(1.1)
    assert to_orchestrator(pair, "real", param) == ()


def test_a_pilot_who_takes_over_beside_a_warning_is_not_overridden(pair: Any) -> None:
    """An ArduCopter with a battery warning reports CRITICAL for the rest of its flight."""
    twin = pair.vehicles["twin"]
    twin.critical = True
    pair.fly(5.0)
    twin.mode = FlightMode.PILOT
    pair.fly(20.0)
    assert pair.core.latched == "takeover"
    assert pair.core.phases["twin"] is ContingencyPhase.PILOT
    assert set(twin.words()) == {"HEARTBEAT"}


@pytest.mark.parametrize("number", [510, 511, 512])
def test_a_failsafe_is_seen_while_messages_are_requested(pair: Any, number: int) -> None:
    """Streams that are missing or slow are requested every 2 s, which changes no mode."""
    real = pair.vehicles["real"]
    for _ in range(3):
        to_orchestrator(pair, "real", command(number, 32.0, 20000.0))
        pair.fly(1.0)
    real.mode = FlightMode.RTL
    pair.fly(1.0)
    assert pair.core.latched == "failsafe"


@pytest.mark.parametrize("every_s", [0.05, 0.4])
def test_an_old_word_that_it_is_disarmed_ends_no_landing(pair: Any, every_s: float) -> None:
    real = pair.vehicles["real"]
    real.armed = False
    replay = real.heartbeat()
    real.armed = True
    abort(pair)
    while real.armed:
        pair.apply(pair.core.from_vehicle("real", replay, pair.t_s))
        assert not pair.core.all_down
        assert "real" in pair.core.may_be_armed(pair.t_s)
        assert pair.t_s < 60.0
        pair.fly(every_s)
    pair.fly(3.0)
    assert pair.core.all_down
    assert pair.core.may_be_armed(pair.t_s) == ()


def test_a_pilot_takes_over_in_the_middle_of_a_landing(pair: Any) -> None:
    abort(pair)
    pair.fly(2.0)
    real = pair.vehicles["real"]
    real.mode = FlightMode.PILOT
    pair.fly(0.1)
    before = real.words().count("LAND")
    pair.fly(10.0)
    assert real.armed
    assert real.words().count("LAND") == before


def test_a_disarmed_vehicle_in_a_pilot_mode_is_no_takeover(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(
        fake_vehicle, rig, real={"mode": FlightMode.PILOT, "armed": False, "up_m": 0.0}
    )
    pair.fly(5.0)
    assert pair.core.latched is None
    pair.vehicles["real"].armed = True
    pair.fly(1.1)
    assert pair.core.latched == "takeover"


def test_a_failsafe_is_supervised_not_fought(pair: Any) -> None:
    real = pair.vehicles["real"]
    real.mode, real.critical, real.north_m_s = FlightMode.RTL, True, -0.5
    pair.fly(5.0)
    assert pair.core.latched == "failsafe"
    assert pair.core.phases["real"] is ContingencyPhase.SUPERVISE
    assert set(real.words()) == {"HEARTBEAT"}
    real.mode = FlightMode.LAND
    pair.fly(20.0)
    assert pair.core.all_down
    # On the ground it is disarmed; until then nothing is asked of it.
    told = [e.t_s for e in pair.events if e.vehicle == "real" and "on the ground" in e.text]
    assert {word for t_s, word in real.heard if t_s < told[0]} == {"HEARTBEAT"}
    event = next(event for event in pair.events if event.kind == "failsafe")
    assert event.text == "real: its autopilot changed from OFFBOARD to RTL without a command"


def test_a_failsafe_during_the_guard_s_hold_is_supervised_too(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(
        fake_vehicle, rig, real={"ignores": frozenset({FlightMode.HOLD, FlightMode.LAND})}
    )
    abort(pair)
    pair.fly(0.5)
    pair.vehicles["real"].mode = FlightMode.RTL
    pair.vehicles["real"].north_m_s = -0.5
    pair.fly(0.1)
    assert pair.core.phases["real"] is ContingencyPhase.SUPERVISE
    assert pair.kinds() == ["abort", "failsafe"]


@pytest.mark.parametrize("mode", [FlightMode.LAND, FlightMode.RTL, FlightMode.HOLD])
def test_a_mode_that_the_orchestrator_asked_for_is_no_failsafe(pair: Any, mode: FlightMode) -> None:
    to_orchestrator(pair, "real", mode_command(mode))
    pair.fly(1.1)
    assert pair.vehicles["real"].mode is mode
    assert pair.core.latched is None


@pytest.mark.parametrize("name", ["real", "twin"])
@pytest.mark.parametrize(
    ("asked", "mode"), [(FlightMode.GUIDED, FlightMode.RTL), (FlightMode.HOLD, FlightMode.LAND)]
)
def test_a_failsafe_beside_a_request_of_another_mode_is_seen(
    pair: Any, name: str, asked: FlightMode, mode: FlightMode
) -> None:
    """A low battery does not wait until a command of the orchestrator is seconds old."""
    vehicle = pair.vehicles[name]
    request = vehicle.autopilot.set_mode(vehicle.target, asked)
    to_orchestrator(pair, name, DRIVER.pack(request))
    pair.fly(1.1)
    assert (vehicle.mode, pair.core.latched) == (asked, None)
    vehicle.mode = mode
    pair.fly(0.1)
    assert pair.core.latched == "failsafe"


def test_a_failsafe_beside_a_takeoff_is_seen(pair: Any) -> None:
    real = pair.vehicles["real"]
    to_orchestrator(pair, "real", command(mavlink.MAV_CMD_NAV_TAKEOFF))
    real.mode = FlightMode.TAKEOFF
    pair.fly(1.1)
    assert pair.core.latched is None
    real.mode = FlightMode.RTL
    pair.fly(0.1)
    assert pair.core.latched == "failsafe"


@pytest.mark.parametrize(
    "frame",
    [
        command(mavlink.MAV_CMD_CONDITION_YAW, 90.0),
        command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1.0, 2.0),
        command(mavlink.MAV_CMD_DO_REPOSITION),
        DRIVER.pack(mavlink.MAVLink_set_mode_message(1, 1, px4_custom_mode(6, 0))),
        mode_command(FlightMode.GUIDED),
    ],
    ids=["CONDITION_YAW", "DO_CHANGE_SPEED", "DO_REPOSITION", "SET_MODE", "DO_SET_MODE"],
)
def test_a_failsafe_is_seen_whatever_a_program_repeats(pair: Any, frame: bytes) -> None:
    """Programs turn the vehicle and set its speed by commands, many of them each second."""
    for _ in range(4):
        to_orchestrator(pair, "real", frame)
        pair.fly(1.0)
    assert pair.core.latched is None
    pair.vehicles["real"].mode = FlightMode.RTL
    to_orchestrator(pair, "real", frame)
    pair.vehicles["real"].mode = FlightMode.RTL
    pair.fly(0.1)
    assert pair.core.latched == "failsafe"


def test_a_whole_flight_of_the_orchestrator_s_is_not_disturbed(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"armed": False, "up_m": 0.0, "mode": FlightMode.HOLD})
    real = pair.vehicles["real"]
    to_orchestrator(pair, "real", command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0))
    pair.fly(5.0)
    real.mode = FlightMode.TAKEOFF
    real.up_m = 2.0
    pair.fly(8.0)
    real.mode = FlightMode.HOLD
    pair.fly(5.0)
    to_orchestrator(pair, "real", mode_command(FlightMode.GUIDED))
    pair.fly(10.0)
    to_orchestrator(pair, "real", mode_command(FlightMode.LAND))
    pair.fly(20.0)
    assert not real.armed
    assert pair.core.latched is None
    assert pair.events == []
