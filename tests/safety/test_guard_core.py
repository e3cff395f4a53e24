import itertools
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from safety.geofence import Fence
from safety.guard.contingency import Phase
from safety.guard.core import GuardCore
from safety.guard.events import (
    GuardedVehicle,
    GuardEvent,
    GuardSettings,
    OperatorCommand,
    ToGcs,
    ToOrchestrator,
    ToVehicle,
    decisive,
)
from safety.samples import PoseSample
from vehicles.anchor import Anchor
from vehicles.autopilots.ardupilot import ArduCopter
from vehicles.autopilots.base import Autopilot, Mode, Target, command_long, own_heartbeat
from vehicles.autopilots.px4 import Px4
from vehicles.mavlink.codec import Codec
from worlds.frames import Pose

FENCE = Fence.box(north_m=(-3, 5), east_m=(-3, 3), up_m=(-1, 6))
DRIVER = Codec(system_id=245, component_id=190)
GCS = Codec(system_id=255, component_id=190)


def setpoint(autopilot: Autopilot | None = None, system: int = 1) -> bytes:
    message = (autopilot or Px4()).velocity_setpoint(
        Target(system), t_boot_ms=0, velocity_ned_m_s=(1.0, 0.0, 0.0)
    )
    return DRIVER.pack(message)


def command(number: int, *parameters: float, codec: Codec = DRIVER) -> bytes:
    return codec.pack(command_long(Target(1), number, *parameters))


def mode_command(mode: Mode, codec: Codec = DRIVER) -> bytes:
    return codec.pack(Px4().set_mode(Target(1), mode))


@pytest.fixture
def pair(fake_vehicle: Any, rig: Any) -> Any:
    """Return a rig of a PX4 as real and an ArduCopter as twin, both flying in GUIDED."""
    return make_pair(fake_vehicle, rig)


def make_pair(
    fake_vehicle: Any,
    rig: Any,
    *,
    settings: GuardSettings | None = None,
    real: dict[str, Any] | None = None,
    **guarded: Any,
) -> Any:
    vehicles = {
        "real": fake_vehicle("real", Px4(), system=1, **(real or {})),
        "twin": fake_vehicle("twin", ArduCopter(), system=2),
    }
    core = GuardCore(
        vehicles={
            "real": GuardedVehicle(
                autopilot=Px4(), target=Target(1), fence=FENCE, **{"attached": True, **guarded}
            ),
            "twin": GuardedVehicle(autopilot=ArduCopter(), target=Target(2), fence=FENCE),
        },
        settings=settings,
    )
    made = rig(core, vehicles)
    made.fly(1.0)
    return made


def abort(rig: Any, who: str = "anna") -> None:
    rig.apply(rig.core.command(OperatorCommand("abort", who, rig.t_s)))


def to_orchestrator(rig: Any, name: str, data: bytes) -> tuple[bytes, ...]:
    outputs = rig.core.from_orchestrator(name, data, rig.t_s)
    rig.apply(outputs)
    return tuple(f for out in outputs if isinstance(out, ToVehicle) for f in out.frames)


# Passing


def test_frames_pass_both_ways_while_all_is_well(pair: Any) -> None:
    beat = pair.vehicles["real"].heartbeat()
    assert pair.core.from_vehicle("real", beat, 2.0) == (ToOrchestrator("real", (beat,)),)
    data = setpoint() + setpoint()
    (out,) = pair.core.from_orchestrator("real", data, 2.0)
    assert b"".join(out.frames) == data
    assert len(out.frames) == 2
    pair.fly(5.0)
    assert pair.events == []
    assert pair.vehicles["real"].heard == []


def test_frames_cut_anywhere_go_out_whole_and_garbage_does_not(pair: Any) -> None:
    data = b"noise" + setpoint() + b"\xfd\x09" + setpoint()
    passed: list[bytes] = []
    for byte in data:
        passed += to_orchestrator(pair, "real", bytes([byte]))
    assert len(passed) == 2
    assert all(frame[0] == 0xFD for frame in passed)


def test_a_ground_station_sees_and_is_heard(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, gcs=True)
    beat = pair.vehicles["real"].heartbeat()
    outputs = pair.core.from_vehicle("real", beat, 2.0)
    assert outputs == (ToOrchestrator("real", (beat,)), ToGcs("real", (beat,)))
    asks = GCS.pack(own_heartbeat())
    assert pair.core.from_gcs("real", asks, 2.0) == (ToVehicle("real", (asks,)),)
    assert pair.core.latched is None


# Abort and the way down


def test_abort_brings_both_down_in_order(pair: Any) -> None:
    abort(pair)
    for vehicle in pair.vehicles.values():
        assert vehicle.words()[:2] == ["ZERO", "HOLD"]
    pair.fly(20.0)
    assert pair.core.all_down
    assert set(pair.core.phases.values()) == {Phase.DOWN}
    for vehicle in pair.vehicles.values():
        assert not vehicle.armed
        words = [word for word in vehicle.words() if word not in {"ZERO", "HEARTBEAT"}]
        assert words[0] == "HOLD"
        assert "LAND" in words
        assert "TERMINATE" not in words
    assert pair.kinds() == ["abort"]
    assert "aborted by anna" in [event.text for event in pair.events]


def test_the_frames_that_brake_come_before_all_words(pair: Any) -> None:
    outputs = pair.core.command(OperatorCommand("abort", "anna", 2.0))
    assert isinstance(outputs[0], ToVehicle)
    assert isinstance(outputs[-1], GuardEvent)


def test_the_latch_is_idempotent_and_names_its_first_cause(pair: Any) -> None:
    abort(pair)
    before = [len(v.heard) for v in pair.vehicles.values()]
    abort(pair, "ben")
    pair.apply(pair.core.bring_down("the other failed", pair.t_s))
    pair.apply(pair.core.bring_down("again", pair.t_s))
    assert [len(v.heard) for v in pair.vehicles.values()] == before
    assert pair.core.latched == "abort"
    assert pair.kinds() == ["abort", "bring_down"]


def test_zero_setpoints_stream_until_the_hold_is_seen(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"ignores": frozenset({Mode.HOLD})})
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
    pair = make_pair(fake_vehicle, rig, real={"up_m": 0.0, "mode": Mode.HOLD})
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
    pair = make_pair(fake_vehicle, rig, real={"up_m": 0.0, "armed": False, "mode": Mode.HOLD})
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
    real.armed, real.up_m, real.mode = True, 2.0, Mode.GUIDED
    pair.fly(2.0)
    assert not pair.core.all_down
    pair.fly(20.0)
    assert pair.core.all_down


def test_a_vehicle_that_never_spoke_is_not_waited_for(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"mute": True})
    abort(pair)
    pair.fly(20.0)
    assert pair.core.all_down


# After the latch


@pytest.mark.parametrize(
    "frame",
    [
        setpoint(),
        mode_command(Mode.GUIDED),
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
        DRIVER.pack(mavlink.MAVLink_param_set_message(1, 1, b"RTL_ALT", 5.0, 9)),
        command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 32, 20000),
        command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148),
    ],
)
def test_what_only_asks_or_keeps_alive_passes(pair: Any, frame: bytes) -> None:
    abort(pair)
    assert to_orchestrator(pair, "real", frame) == (frame,)


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


# Fence


def test_a_breach_is_foreseen_and_stops_both_inside(pair: Any) -> None:
    pair.vehicles["real"].north_m_s = 2.0
    pair.fly(3.0)
    assert pair.core.latched == "fence"
    event = next(event for event in pair.events if event.kind == "fence")
    assert event.vehicle == "real"
    assert "cannot stop before the fence's side" in event.text
    assert pair.vehicles["real"].north_m < 5.0
    pair.fly(20.0)
    assert pair.core.all_down
    outcome = decisive(event)
    assert outcome is not None
    assert outcome.kind == "FAIL"


def test_a_breach_answers_in_the_same_call(pair: Any) -> None:
    sample = PoseSample(pair.t_s, "twin", Pose((9, 0, -2)), (0, 0, 0))
    outputs = pair.core.position(sample)
    assert {out.name for out in outputs if isinstance(out, ToVehicle)} == {"real", "twin"}


def test_the_fence_is_told_once_and_not_of_a_disarmed_vehicle(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"north_m": 50.0, "armed": False, "up_m": 0.0})
    assert pair.kinds() == []
    pair.vehicles["twin"].north_m = 50.0
    pair.fly(10.0)
    assert pair.kinds() == ["fence"]


def test_the_estimate_is_a_position_source_once_it_is_anchored(pair: Any) -> None:
    pair.blind = True
    message = mavlink.MAVLink_local_position_ned_message(0, 1.0, 0, -2, 0, 0, 0)
    frame = pair.vehicles["real"].codec.pack(message)
    pair.apply(pair.core.from_vehicle("real", frame, pair.t_s))
    assert pair.core.latched is None
    pair.core.anchor("real", Anchor((9.0, 0.0, 0.0)))
    pair.apply(pair.core.from_vehicle("real", frame, pair.t_s))
    assert pair.core.latched == "fence"


def test_a_position_that_is_not_finite_moves_nothing(pair: Any) -> None:
    for bad in (float("nan"), float("inf")):
        sample = PoseSample(pair.t_s, "real", Pose((bad, 0, -2)), (0, 0, 0))
        pair.apply(pair.core.position(sample))
    assert pair.core.latched is None
    assert pair.kinds() == ["pose"]


# Silence and loss


def test_orchestrator_silence_lands_both_within_half_a_second(pair: Any) -> None:
    def alive() -> None:
        pair.apply(pair.core.orchestrator_alive(pair.t_s))

    pair.fly(3.0, each=alive)
    assert not pair.core.latched
    killed_s = pair.t_s
    pair.fly(20.0)
    assert pair.core.latched == "silence"
    first = pair.vehicles["real"].heard[0]
    assert first[0] - killed_s <= 0.5
    assert pair.core.all_down
    pair.apply(pair.core.orchestrator_alive(pair.t_s))
    assert pair.kinds() == ["silence", "heard"]
    assert to_orchestrator(pair, "real", setpoint()) == ()


def test_an_orchestrator_that_never_said_so_is_not_missed(pair: Any) -> None:
    pair.fly(60.0)
    assert pair.core.latched is None


def test_a_lost_vehicle_lands_the_other_and_is_told_blindly(pair: Any) -> None:
    pair.vehicles["real"].mute = True
    pair.fly(20.0)
    assert pair.core.latched == "lost"
    assert not pair.vehicles["twin"].armed
    assert "LAND" in pair.vehicles["real"].words()
    assert not pair.core.all_down
    pair.vehicles["real"].mute = False
    pair.fly(5.0)
    assert pair.core.all_down
    assert pair.kinds() == ["lost", "heard"]


def test_a_vehicle_is_heard_by_its_own_system_only(pair: Any) -> None:
    pair.vehicles["real"].mute = True
    stranger = pair.vehicles["twin"].heartbeat()

    def talk() -> None:
        pair.apply(pair.core.from_vehicle("real", stranger, pair.t_s))

    pair.fly(5.0, each=talk)
    assert pair.core.latched == "lost"


# Mode changes that nobody asked for


def test_a_pilot_takes_over_and_the_guard_keeps_out(pair: Any) -> None:
    real = pair.vehicles["real"]
    real.mode = Mode.PILOT
    pair.fly(1.1)
    assert pair.core.latched == "takeover"
    heard_before = len(real.heard)
    pair.fly(20.0)
    assert {word for _, word in real.heard[heard_before:]} == {"HEARTBEAT"}
    assert len(real.heard) - heard_before == 20
    assert not pair.vehicles["twin"].armed
    assert to_orchestrator(pair, "real", mode_command(Mode.GUIDED)) == ()
    param = DRIVER.pack(mavlink.MAVLink_param_set_message(1, 1, b"RTL_ALT", 5.0, 9))
    assert to_orchestrator(pair, "real", param) == ()
    assert pair.core.phases["real"] is Phase.PILOT
    real.armed = False
    pair.fly(1.1)
    assert pair.core.all_down


def test_a_pilot_takes_over_in_the_middle_of_a_landing(pair: Any) -> None:
    abort(pair)
    pair.fly(2.0)
    real = pair.vehicles["real"]
    real.mode = Mode.PILOT
    pair.fly(0.1)
    before = real.words().count("LAND")
    pair.fly(10.0)
    assert real.armed
    assert real.words().count("LAND") == before


def test_a_disarmed_vehicle_in_a_pilot_mode_is_no_takeover(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"mode": Mode.PILOT, "armed": False, "up_m": 0.0})
    pair.fly(5.0)
    assert pair.core.latched is None
    pair.vehicles["real"].armed = True
    pair.fly(1.1)
    assert pair.core.latched == "takeover"


@pytest.mark.parametrize(
    ("frame", "takes"),
    [
        (mode_command(Mode.HOLD, GCS), True),
        (command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, codec=GCS), True),
        (command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, codec=GCS), True),
        (GCS.pack(mavlink.MAVLink_set_mode_message(1, 1, 4)), True),
        (command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148, codec=GCS), False),
        (GCS.pack(mavlink.MAVLink_param_request_list_message(1, 1)), False),
        (GCS.pack(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0)), False),
    ],
)
def test_a_ground_station_takes_over_by_a_mode_command(
    pair: Any, frame: bytes, takes: bool
) -> None:
    outputs = pair.core.from_gcs("real", frame, pair.t_s)
    assert outputs[0] == ToVehicle("real", (frame,))
    pair.apply(outputs)
    assert (pair.core.latched == "takeover") == takes
    assert (pair.core.phases["real"] is Phase.PILOT) == takes
    pair.fly(20.0)
    assert pair.vehicles["twin"].armed == (not takes)


def test_a_failsafe_is_supervised_not_fought(pair: Any) -> None:
    real = pair.vehicles["real"]
    real.mode, real.critical, real.north_m_s = Mode.RTL, True, -0.5
    pair.fly(5.0)
    assert pair.core.latched == "failsafe"
    assert pair.core.phases["real"] is Phase.SUPERVISE
    assert set(real.words()) == {"HEARTBEAT"}
    real.mode = Mode.LAND
    pair.fly(20.0)
    assert pair.core.all_down
    # On the ground it is disarmed; until then nothing is asked of it.
    told = [e.t_s for e in pair.events if e.vehicle == "real" and "on the ground" in e.text]
    assert {word for t_s, word in real.heard if t_s < told[0]} == {"HEARTBEAT"}
    event = next(event for event in pair.events if event.kind == "failsafe")
    assert event.text == "real: its autopilot went from OFFBOARD to RTL by itself"


def test_a_failsafe_during_the_guard_s_hold_is_supervised_too(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"ignores": frozenset({Mode.HOLD, Mode.LAND})})
    abort(pair)
    pair.fly(0.5)
    pair.vehicles["real"].mode = Mode.RTL
    pair.vehicles["real"].north_m_s = -0.5
    pair.fly(0.1)
    assert pair.core.phases["real"] is Phase.SUPERVISE
    assert pair.kinds() == ["abort", "failsafe"]


@pytest.mark.parametrize("mode", [Mode.LAND, Mode.RTL, Mode.HOLD])
def test_a_mode_that_the_orchestrator_asked_for_is_no_failsafe(pair: Any, mode: Mode) -> None:
    to_orchestrator(pair, "real", mode_command(mode))
    pair.fly(1.1)
    assert pair.vehicles["real"].mode is mode
    assert pair.core.latched is None


def test_a_whole_flight_of_the_orchestrator_s_is_not_disturbed(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"armed": False, "up_m": 0.0, "mode": Mode.HOLD})
    real = pair.vehicles["real"]
    to_orchestrator(pair, "real", command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0))
    pair.fly(5.0)
    real.mode = Mode.TAKEOFF
    real.up_m = 2.0
    pair.fly(8.0)
    real.mode = Mode.HOLD
    pair.fly(5.0)
    to_orchestrator(pair, "real", mode_command(Mode.GUIDED))
    pair.fly(10.0)
    to_orchestrator(pair, "real", mode_command(Mode.LAND))
    pair.fly(20.0)
    assert not real.armed
    assert pair.core.latched is None
    assert pair.events == []


# Hold and resume


def test_hold_and_resume(pair: Any) -> None:
    pair.apply(pair.core.command(OperatorCommand("hold", "anna", pair.t_s)))
    pair.fly(5.0)
    assert {v.mode for v in pair.vehicles.values()} == {Mode.HOLD}
    assert to_orchestrator(pair, "real", setpoint()) == ()
    assert pair.core.latched is None
    pair.apply(pair.core.command(OperatorCommand("resume", "anna", pair.t_s)))
    assert to_orchestrator(pair, "real", setpoint())
    to_orchestrator(pair, "real", mode_command(Mode.GUIDED))
    pair.fly(5.0)
    assert pair.core.latched is None
    assert pair.kinds() == ["hold", "dropped", "resume"]


def test_abort_wins_over_hold_and_nothing_resumes_it(pair: Any) -> None:
    pair.apply(pair.core.command(OperatorCommand("hold", "anna", pair.t_s)))
    pair.fly(1.0)
    abort(pair)
    pair.apply(pair.core.command(OperatorCommand("resume", "anna", pair.t_s)))
    assert to_orchestrator(pair, "real", setpoint()) == ()
    pair.fly(20.0)
    assert pair.core.all_down
    assert pair.kinds() == ["hold", "abort", "refused", "dropped"]


def test_a_hold_after_an_abort_is_refused(pair: Any) -> None:
    abort(pair)
    for kind in ("hold", "resume"):
        pair.apply(pair.core.command(OperatorCommand(kind, "anna", pair.t_s)))
    assert pair.kinds() == ["abort", "refused", "refused"]
    assert not pair.core.paused


def test_a_resume_of_nothing_is_refused(pair: Any) -> None:
    pair.apply(pair.core.command(OperatorCommand("resume", "anna", pair.t_s)))
    assert pair.kinds() == ["refused"]


# Termination


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


def test_a_landing_that_nobody_reports_still_ends_disarmed(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"tells_landed": False, "disarms": False})
    abort(pair)
    pair.fly(30.0)
    words = pair.vehicles["real"].words()
    assert "DISARM" in words
    assert "TERMINATE" not in words
    assert pair.core.all_down


def test_every_settling_event_has_its_verdict() -> None:
    kinds = {
        kind: getattr(decisive(GuardEvent(1.0, kind, "real", "x")), "kind", None)
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
    assert decisive(GuardEvent(1.0, "bring_down", "", "x")) is None
    assert decisive(GuardEvent(1.0, "hold", "", "x")) is None
