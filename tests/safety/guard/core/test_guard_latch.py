import itertools
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.safety.guard.guard_rigs import (
    DRIVER,
    abort,
    command,
    make_pair,
    mode_command,
    setpoint,
    to_orchestrator,
)
from wil_campaign.safety.guard.core.commands import BringDown, OperatorAction
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.events import GuardEvent, ToVehicle, decisive_guard_event
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.vehicles.autopilots.autopilot import FlightMode, own_heartbeat


def test_abort_brings_both_down_in_order(pair: Any) -> None:
    abort(pair)
    for vehicle in pair.vehicles.values():
        assert vehicle.words()[:2] == ["ZERO", "HOLD"]
    pair.fly(20.0)
    assert pair.core.all_down
    assert set(pair.core.phases.values()) == {ContingencyPhase.DOWN}
    for vehicle in pair.vehicles.values():
        assert not vehicle.armed
        words = [word for word in vehicle.words() if word not in {"ZERO", "HEARTBEAT"}]
        assert words[0] == "HOLD"
        assert "LAND" in words
        assert "TERMINATE" not in words
    assert pair.kinds() == ["abort"]
    assert "aborted by anna" in [event.text for event in pair.events]


def test_the_frames_that_brake_come_before_all_words(pair: Any) -> None:
    outputs = pair.core.apply(OperatorAction(OperatorCommand("abort", "anna")), 2.0)
    assert isinstance(outputs[0], ToVehicle)
    assert isinstance(outputs[-1], GuardEvent)


def test_the_latch_is_idempotent_and_names_its_first_cause(pair: Any) -> None:
    abort(pair)
    before = [len(v.heard) for v in pair.vehicles.values()]
    abort(pair, "ben")
    pair.apply(pair.core.apply(BringDown("the other failed"), pair.t_s))
    pair.apply(pair.core.apply(BringDown("again"), pair.t_s))
    assert [len(v.heard) for v in pair.vehicles.values()] == before
    assert pair.core.latched == "abort"
    assert pair.kinds() == ["abort", "bring_down"]


@pytest.mark.parametrize("attached", [True, False])
@pytest.mark.parametrize("is_armed_by_us", [True, False])
def test_what_somebody_else_armed_is_brought_down_by_an_abort_alone(
    fake_vehicle: Any, rig: Any, attached: bool, is_armed_by_us: bool
) -> None:
    """As a mission by another link, which a run that did not get ready would end."""
    pair = make_pair(fake_vehicle, rig, real={"mode": FlightMode.MISSION}, attached=attached)
    real = pair.vehicles["real"]
    if is_armed_by_us:
        arms = DRIVER.pack(real.autopilot.arm(real.target))
        pair.apply(pair.core.from_orchestrator("real", arms, pair.t_s))
    pair.fly(5.0)
    pair.apply(pair.core.apply(BringDown("not ready"), pair.t_s))
    pair.fly(20.0)
    left_alone = attached and not is_armed_by_us
    assert real.armed == left_alone
    assert ("LAND" in real.words(), pair.core.all_down) == (not left_alone, not left_alone)
    phase = ContingencyPhase.PILOT if left_alone else ContingencyPhase.DOWN
    assert pair.core.phases == {"real": phase, "twin": ContingencyPhase.DOWN}
    pair = make_pair(fake_vehicle, rig, real={"mode": FlightMode.MISSION}, attached=attached)
    abort(pair)
    pair.fly(20.0)
    assert pair.core.all_down


def test_parameters_are_restored_after_a_run_that_armed_nothing(
    fake_vehicle: Any, rig: Any
) -> None:
    pair = make_pair(fake_vehicle, rig, real={"armed": False, "up_m": 0.0}, attached=True)
    pair.vehicles["twin"].armed = False
    pair.fly(2.0)
    pair.apply(pair.core.apply(BringDown("not armed, as --no-arm asks"), pair.t_s))
    pair.fly(2.0)
    sets = DRIVER.pack(mavlink.MAVLink_param_set_message(1, 1, b"NAV_DLL_ACT", 0.0, 6))
    pair.apply(pair.core.from_orchestrator("real", sets, pair.t_s))
    assert "PARAM_SET" in pair.vehicles["real"].words()


def test_zero_setpoints_stream_until_the_hold_is_seen(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"ignores": frozenset({FlightMode.HOLD})})
    abort(pair)
    pair.fly(1.5)
    zeros = [t for t, word in pair.vehicles["real"].heard if word == "ZERO"]
    # PX4 gives up OFFBOARD after 1 s without; 20 Hz is what it is asked to get.
    assert max(b - a for a, b in itertools.pairwise(zeros)) < 0.06
    # The hold that the other took ended its stream with the next heartbeat.
    assert pair.vehicles["twin"].words().count("ZERO") < 4
    pair.fly(30.0)
    assert pair.core.all_down


def test_commands_repeat_until_they_are_obeyed(pair: Any) -> None:
    pair.vehicles["real"].deaf = True
    abort(pair)
    pair.fly(30.0)
    assert pair.vehicles["real"].armed
    assert not pair.vehicles["twin"].armed
    assert not pair.core.all_down
    pair.vehicles["real"].deaf = False
    pair.fly(20.0)
    assert pair.core.all_down


def test_a_vehicle_on_the_ground_is_disarmed(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"up_m": 0.0, "mode": FlightMode.HOLD})
    abort(pair)
    pair.fly(0.2)
    assert not pair.vehicles["real"].armed


def test_a_disarmed_vehicle_is_left_alone(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"up_m": 0.0, "armed": False})
    abort(pair)
    pair.fly(10.0)
    assert set(pair.vehicles["real"].words()) == {"HEARTBEAT"}
    assert pair.core.all_down


def test_an_arming_that_just_passed_counts_as_armed(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"up_m": 0.0, "armed": False, "mode": FlightMode.HOLD})
    to_orchestrator(pair, "real", command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0))
    assert pair.vehicles["real"].armed
    abort(pair)
    assert "DISARM" in pair.vehicles["real"].words()
    pair.fly(20.0)
    assert not pair.vehicles["real"].armed
    assert pair.core.all_down


def test_a_vehicle_that_arms_again_after_all_comes_down_again(pair: Any) -> None:
    abort(pair)
    pair.fly(20.0)
    real = pair.vehicles["real"]
    real.armed, real.up_m, real.mode = True, 2.0, FlightMode.GUIDED
    pair.fly(2.0)
    assert not pair.core.all_down
    pair.fly(20.0)
    assert pair.core.all_down


def test_a_vehicle_that_never_spoke_is_not_waited_for(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"mute": True})
    abort(pair)
    pair.fly(20.0)
    assert pair.core.all_down


@pytest.mark.parametrize(
    "frame",
    [
        setpoint(),
        mode_command(FlightMode.GUIDED),
        command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0),
        command(mavlink.MAV_CMD_NAV_TAKEOFF),
        command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0),
        DRIVER.pack(mavlink.MAVLink_set_mode_message(1, 1, 4)),
        DRIVER.pack(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0)),
        DRIVER.pack(mavlink.MAVLink_mission_count_message(1, 1, 3)),
        DRIVER.pack(mavlink.MAVLink_command_int_message(1, 1, 0, 192, 0, 0, 0, 0, 0, 0, 0, 0, 0)),
    ],
)
def test_nothing_that_moves_the_vehicle_passes(pair: Any, frame: bytes) -> None:
    assert to_orchestrator(pair, "twin", frame) or "TERMINATION" in repr(frame)
    abort(pair)
    pair.events.clear()
    for _ in range(3):
        assert to_orchestrator(pair, "twin", frame) == ()
    assert pair.kinds() == ["dropped"]
    assert list(pair.core.dropped.values()) == [3]


@pytest.mark.parametrize(
    "frame",
    [
        DRIVER.pack(own_heartbeat()),
        DRIVER.pack(mavlink.MAVLink_timesync_message(0, 1)),
        DRIVER.pack(mavlink.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1)),
        command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 32, 20000),
        command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148),
    ],
)
def test_requests_and_heartbeats_pass_after_an_abort(pair: Any, frame: bytes) -> None:
    abort(pair)
    assert to_orchestrator(pair, "real", frame) == (frame,)


RESTORING = [
    DRIVER.pack(mavlink.MAVLink_mission_count_message(1, 1, 3, 1)),
    DRIVER.pack(mavlink.MAVLink_param_set_message(1, 1, b"RTL_ALT", 5.0, 9)),
]
"""What restores a vehicle's own fence and parameters; each may change how it flies."""


@pytest.mark.parametrize("frame", RESTORING)
def test_fence_and_parameters_are_restored_once_all_are_down(pair: Any, frame: bytes) -> None:
    abort(pair)
    assert to_orchestrator(pair, "real", frame) == ()
    pair.fly(20.0)
    assert pair.core.all_down
    assert to_orchestrator(pair, "real", frame) == (frame,)


@pytest.mark.parametrize("frame", RESTORING)
def test_a_held_vehicle_may_be_given_a_fence_and_nothing_that_moves_it(
    pair: Any, frame: bytes
) -> None:
    pair.apply(pair.core.apply(OperatorAction(OperatorCommand("hold", "anna")), pair.t_s))
    assert to_orchestrator(pair, "real", frame) == (frame,)
    for moving in (setpoint(), mode_command(FlightMode.GUIDED)):
        assert to_orchestrator(pair, "real", moving) == ()
    abort(pair)
    assert to_orchestrator(pair, "real", frame) == ()


def test_a_setpoint_between_harmless_frames_is_taken_out(pair: Any) -> None:
    abort(pair)
    sync = DRIVER.pack(mavlink.MAVLink_timesync_message(0, 1))
    assert to_orchestrator(pair, "real", sync + setpoint() + sync) == (sync, sync)


@pytest.mark.parametrize(
    "frame",
    [
        command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0),
        command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, 21196.0),
    ],
)
def test_the_orchestrator_cannot_cut_an_attached_vehicle_s_motors(
    fake_vehicle: Any, rig: Any, frame: bytes
) -> None:
    pair = make_pair(fake_vehicle, rig)
    assert to_orchestrator(pair, "real", frame) == ()
    assert pair.kinds() == ["dropped"]
    assert to_orchestrator(pair, "twin", frame) == (frame,)
    opted_in = make_pair(fake_vehicle, rig, terminate=True)
    assert to_orchestrator(opted_in, "real", frame) == (frame,)


def test_a_plain_disarm_passes(pair: Any) -> None:
    frame = command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
    assert to_orchestrator(pair, "real", frame) == (frame,)


@pytest.mark.parametrize(
    ("guarded", "cut"),
    [
        ({"attached": True}, False),
        ({"attached": True, "terminate": True}, True),
        ({"attached": False}, True),
    ],
)
def test_motors_are_cut_as_the_campaign_allows(
    fake_vehicle: Any, rig: Any, guarded: dict[str, Any], cut: bool
) -> None:
    pair = make_pair(fake_vehicle, rig, real={"stuck": True}, **guarded)
    abort(pair)
    pair.fly(60.0)
    assert ("TERMINATE" in pair.vehicles["real"].words()) == cut
    assert "TERMINATE" not in pair.vehicles["twin"].words()


def test_motors_of_a_vehicle_that_lands_by_itself_meanwhile_are_not_cut(
    fake_vehicle: Any, rig: Any
) -> None:
    """Its link is open in one direction: nothing of the abort arrives until its failsafe lands."""
    pair = make_pair(fake_vehicle, rig, real={"up_m": 5.0}, attached=True, terminate=True)
    real = pair.vehicles["real"]
    real.deaf = True
    abort(pair)
    pair.fly(20.0)
    real.mode = FlightMode.LAND
    pair.fly(4.0)
    real.deaf = False
    pair.fly(20.0)
    assert "TERMINATE" not in real.words()
    assert (real.up_m, pair.core.all_down) == (0.0, True)


def test_motors_are_not_cut_by_a_place_that_repeats_while_its_vehicle_is_silent(
    fake_vehicle: Any, rig: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It hears all of it, and sinks; its pose source stands where it was when its link fell."""
    pair = make_pair(fake_vehicle, rig, real={"up_m": 15.0}, attached=True, terminate=True)
    real = pair.vehicles["real"]
    real.mute = True
    stands = real.sample(pair.t_s)
    monkeypatch.setattr(real, "sample", lambda t_s: stands._replace(t_s=t_s))
    pair.fly(60.0)
    assert "TERMINATE" not in real.words()
    assert (real.up_m, real.armed) == (0.0, False)


def test_an_unreported_landing_still_ends_disarmed(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"tells_landed": False, "disarms": False})
    abort(pair)
    pair.fly(30.0)
    words = pair.vehicles["real"].words()
    assert "DISARM" in words
    assert "TERMINATE" not in words
    assert pair.core.all_down


def test_every_settling_event_has_its_verdict() -> None:
    kinds = {
        kind: getattr(decisive_guard_event(GuardEvent(1.0, kind, "real", "x")), "kind", None)
        for kind in ("fence", "failsafe", "silence", "lost", "abort", "takeover")
    }
    assert kinds == {
        "fence": "FAIL",
        "failsafe": "FAIL",
        "silence": "ERROR",
        "lost": "ERROR",
        "abort": "ABORTED",
        "takeover": "ABORTED",
    }
    assert decisive_guard_event(GuardEvent(1.0, "bring_down", "", "x")) is None
    assert decisive_guard_event(GuardEvent(1.0, "hold", "", "x")) is None
