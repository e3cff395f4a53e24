import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.safety.guard.guard_rigs import (
    DRIVER,
    FENCE,
    GCS,
    abort,
    make_pair,
    mode_command,
    setpoint,
    to_orchestrator,
)
from tests.vehicles.px4_modes import px4_custom_mode
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import (
    AnchorAt,
    BringDown,
    ClocksApart,
    CoreMessage,
    NewFences,
    OperatorAction,
    OrchestratorAlive,
    OrchestratorEnded,
    VehicleGone,
)
from wil_campaign.safety.guard.core.events import (
    EventKind,
    GuardedVehicle,
    GuardEvent,
    ToGcs,
    ToOrchestrator,
    ToVehicle,
    decisive_guard_event,
)
from wil_campaign.safety.guard.core.guard_core import GuardCore
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.autopilots.autopilot import FlightMode, MavlinkTarget, own_heartbeat
from wil_campaign.vehicles.autopilots.failsafes import OWN_SYSTEM_ID
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.worlds.frames import Pose


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


def test_a_ground_station_receives_and_is_received(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, gcs=True)
    beat = pair.vehicles["real"].heartbeat()
    outputs = pair.core.from_vehicle("real", beat, 2.0)
    assert outputs == (ToOrchestrator("real", (beat,)), ToGcs("real", (beat,)))
    asks = GCS.pack(own_heartbeat())
    assert pair.core.from_gcs("real", asks, 2.0) == (ToVehicle("real", (asks,)),)
    assert pair.core.latched is None


def test_a_breach_is_foreseen_and_stops_both_inside(pair: Any) -> None:
    pair.vehicles["real"].north_m_s = 2.0
    pair.fly(3.0)
    assert pair.core.latched == "fence"
    event = next(event for event in pair.events if event.kind == "fence")
    assert event.vehicle == "real"
    assert "cannot stop before the fence's north side" in event.text
    assert pair.vehicles["real"].north_m < 5.0
    pair.fly(20.0)
    assert pair.core.all_down
    outcome = decisive_guard_event(event)
    assert outcome is not None
    assert outcome.kind == "FAIL"


def test_a_breach_answers_in_the_same_call(pair: Any) -> None:
    sample = PoseSample(pair.t_s, "twin", Pose((9, 0, -2)), (0, 0, 0))
    outputs = pair.core.position(sample)
    assert {out.name for out in outputs if isinstance(out, ToVehicle)} == {"real", "twin"}


def test_the_guard_speaks_as_the_ground_station_that_the_autopilot_heeds(pair: Any) -> None:
    """ArduPilot heeds the heartbeats, and with SYSID_ENFORCE the commands, of one system only."""
    outputs = pair.core.apply(OperatorAction(OperatorCommand("abort", "anna")), pair.t_s)
    frames = [frame for out in outputs if isinstance(out, ToVehicle) for frame in out.frames]
    assert {(frame[5], frame[6]) for frame in frames} == {(OWN_SYSTEM_ID, 191)}
    assert 0 in {frame[7] for frame in frames}, "a heartbeat is among them"


def test_the_fence_is_reported_once_and_not_of_a_disarmed_vehicle(
    fake_vehicle: Any, rig: Any
) -> None:
    pair = make_pair(fake_vehicle, rig, real={"north_m": 50.0, "armed": False, "up_m": 0.0})
    assert pair.kinds() == []
    pair.vehicles["twin"].north_m = 50.0
    pair.fly(10.0)
    assert pair.kinds() == ["fence"]


def sink(pair: Any) -> None:
    """Have the estimate of real take the ground for deeper than it is, as PX4's does in SITL."""
    sample = PoseSample(pair.t_s, "real", Pose((0, 0, 0.9)), (0, 0, 0.3))
    pair.apply(pair.core.position(sample))


def test_a_landing_vehicle_is_not_held_to_the_floor(pair: Any) -> None:
    real = pair.vehicles["real"]
    to_orchestrator(pair, "real", mode_command(FlightMode.LAND))
    real.mode = FlightMode.LAND
    pair.fly(1.0)
    sink(pair)
    assert pair.core.latched is None
    sideways = PoseSample(pair.t_s, "real", Pose((9, 0, 0.9)), (0, 0, 0))
    pair.apply(pair.core.position(sideways))
    assert pair.core.latched == "fence", "its sides hold"


def test_a_landing_vehicle_is_held_to_the_sides_of_a_changed_fence(pair: Any) -> None:
    smaller = Fence.box(north_m=(-2, 2), east_m=(-3, 3), up_m=(-1, 6))
    pair.apply(pair.core.apply(NewFences("anna", {"real": smaller}), pair.t_s))
    assert pair.kinds() == ["geofence"]
    to_orchestrator(pair, "real", mode_command(FlightMode.LAND))
    pair.vehicles["real"].mode = FlightMode.LAND
    pair.fly(1.0)
    assert pair.core.latched is None
    sideways = PoseSample(pair.t_s, "real", Pose((3, 0, -2)), (0, 0, 0))
    pair.apply(pair.core.position(sideways))
    assert pair.core.latched == "fence"


def test_a_standing_vehicle_is_not_held_to_the_floor(fake_vehicle: Any, rig: Any) -> None:
    pair = make_pair(fake_vehicle, rig, real={"up_m": 0.0})
    sink(pair)
    assert pair.core.latched is None


def test_a_flying_vehicle_is_held_to_the_floor(pair: Any) -> None:
    sink(pair)
    assert "real cannot stop before the fence's floor, 0.10 m away" in pair.events[-1].text


def test_the_estimate_is_a_position_source_once_it_is_anchored(pair: Any) -> None:
    pair.blind = ("real",)
    message = mavlink.MAVLink_local_position_ned_message(0, 1.0, 0, -2, 0, 0, 0)
    frame = pair.vehicles["real"].codec.pack(message)
    pair.apply(pair.core.from_vehicle("real", frame, pair.t_s + 0.5))
    assert pair.core.latched is None
    pair.core.apply(AnchorAt("real", (9.0, 0.0, 0.0), 0.0), 0.0)
    pair.apply(pair.core.from_vehicle("real", frame, pair.t_s + 0.2))
    assert pair.core.latched is None, "who knows better told a position just now"
    pair.apply(pair.core.from_vehicle("real", frame, pair.t_s + 0.5))
    assert pair.core.latched == "fence"


def test_a_vehicle_whose_positions_end_is_landed_for_its_fence_cannot_be_held(pair: Any) -> None:
    pair.fly(1.0)
    pair.blind = ("real",)
    pair.fly(2.9)
    assert pair.core.latched is None
    pair.fly(0.2)
    assert pair.core.latched == "lost"
    lost = [event.text for event in pair.events if event.kind == "lost"]
    assert lost == ["no position of real for 3 s: its fence cannot be held"]
    pair.fly(20.0)
    assert pair.core.all_down


def test_positions_that_end_in_a_landing_are_no_further_cause(pair: Any) -> None:
    pair.fly(1.0)
    abort(pair)
    pair.blind = ("real",)
    pair.fly(3.5)
    assert "lost" not in pair.kinds()


@pytest.mark.parametrize("without", ["fence", "positions", "air"])
def test_positions_are_missed_only_where_they_came_and_a_flying_vehicle_has_a_fence(
    fake_vehicle: Any, rig: Any, without: str
) -> None:
    fence = None if without == "fence" else FENCE
    vehicle = fake_vehicle("real", Px4(), up_m=0.0 if without == "air" else 2.0)
    guarded = GuardedVehicle(autopilot=Px4(), target=MavlinkTarget(1), fence=fence)
    alone = rig(GuardCore(vehicles={"real": guarded}), {"real": vehicle})
    alone.blind = ("real",) if without == "positions" else ()
    alone.fly(1.0)
    alone.blind = ("real",)
    alone.fly(10.0)
    assert alone.core.latched is None


def test_a_position_that_is_not_finite_moves_nothing(pair: Any) -> None:
    for bad in (float("nan"), float("inf")):
        sample = PoseSample(pair.t_s, "real", Pose((bad, 0, -2)), (0, 0, 0))
        pair.apply(pair.core.position(sample))
    assert pair.core.latched is None
    assert pair.kinds() == ["pose"]
    pair.apply(pair.core.position(PoseSample(pair.t_s, "real", Pose((9, 0, -2)), (0, 0, 0))))
    assert pair.core.latched == "fence", "the fence still applies to the positions after it"


def test_orchestrator_silence_lands_both_within_half_a_second(pair: Any) -> None:
    def alive() -> None:
        pair.apply(pair.core.apply(OrchestratorAlive(), pair.t_s))

    pair.fly(3.0, each=alive)
    assert not pair.core.latched
    killed_s = pair.t_s
    pair.fly(20.0)
    assert pair.core.latched == "silence"
    first = pair.vehicles["real"].heard[0]
    assert first[0] - killed_s <= 0.5
    assert pair.core.all_down
    pair.apply(pair.core.apply(OrchestratorAlive(), pair.t_s))
    assert pair.kinds() == ["silence", "heard"]
    assert to_orchestrator(pair, "real", setpoint()) == ()


@pytest.mark.parametrize(
    ("ticks_s", "text"),
    [
        ((6.0,), "no heartbeat from the orchestrator; the guard stood still for 4.9 s itself"),
        ((1.15, 1.35, 1.55), "no heartbeat from the orchestrator"),
    ],
)
def test_a_guard_that_stood_still_itself_says_so(
    pair: Any, ticks_s: tuple[float, ...], text: str
) -> None:
    pair.apply(pair.core.apply(OrchestratorAlive(), 1.1))
    for t_s in (1.1, *ticks_s):
        pair.apply(pair.core.tick(t_s))
    assert [event.text for event in pair.events if event.kind == "silence"] == [text]


def test_an_orchestrator_that_never_was_alive_is_not_missed(pair: Any) -> None:
    pair.fly(60.0)
    assert pair.core.latched is None


def test_a_lost_vehicle_lands_the_other_and_is_commanded_blindly(pair: Any) -> None:
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


def test_a_simulator_that_ended_is_reported_and_the_other_vehicle_lands(pair: Any) -> None:
    pair.apply(pair.core.apply(VehicleGone("twin", "twin: its simulator ended"), pair.t_s))
    assert pair.core.latched == "lost"
    (event,) = [one for one in pair.events if one.kind == "lost"]
    assert (event.vehicle, event.text) == ("twin", "twin: its simulator ended")
    pair.fly(20.0)
    assert not pair.vehicles["real"].armed
    assert pair.kinds() == ["lost", "heard"], "its messages still arrive"


@pytest.mark.parametrize(
    ("message", "kind", "vehicle", "text"),
    [
        (OperatorAction(OperatorCommand("abort", "anna")), "abort", "", "aborted by anna"),
        (OperatorAction(OperatorCommand("hold", "anna")), "hold", "", "held by anna"),
        (BringDown("the twin is late"), "bring_down", "", "the twin is late"),
        (NewFences("anna", {"twin": FENCE}), "geofence", "", "anna changed the fence of twin"),
        (VehicleGone("twin", "twin ended"), "lost", "twin", "twin ended"),
        (ClocksApart("twin", "twin is behind"), "clock", "twin", "twin is behind"),
        (OrchestratorEnded(), "silence", "", "the orchestrator ended"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_message_is_applied_at_its_time_and_reported_in_its_words(
    pair: Any, message: CoreMessage, kind: EventKind, vehicle: str, text: str
) -> None:
    at_s = pair.t_s + 0.01
    outputs = pair.core.apply(message, at_s)
    events = [
        output for output in outputs if isinstance(output, GuardEvent) and output.kind != "action"
    ]
    assert events == [GuardEvent(at_s, kind, vehicle, text)]


def test_the_guard_reads_no_files_of_fences(pair: Any) -> None:
    with pytest.raises(ValueError, match="the guard takes parsed fences"):
        pair.core.apply(OperatorAction(OperatorCommand("geofence", "anna", document="a file")), 1.0)


@pytest.mark.parametrize("lands", [True, False])
def test_the_end_of_the_orchestrator_lands_what_may_be_armed(pair: Any, *, lands: bool) -> None:
    if not lands:
        for vehicle in pair.vehicles.values():
            vehicle.armed = False
        pair.fly(5.0)
    pair.apply(pair.core.apply(OrchestratorEnded(), pair.t_s))
    assert pair.core.latched == ("silence" if lands else None)
    texts = [event.text for event in pair.events if event.kind == "silence"]
    assert texts == (["the orchestrator ended"] if lands else [])


def test_a_simulator_that_ended_is_not_awaited(pair: Any) -> None:
    pair.apply(pair.core.apply(VehicleGone("twin", "twin: its simulator ended"), pair.t_s))
    pair.vehicles["twin"].mute = True
    pair.fly(20.0)
    assert pair.core.all_down
    assert pair.kinds() == ["lost"]
    assert "LAND" not in pair.vehicles["twin"].words()


def test_an_anchor_shifts_and_turns_a_vehicles_estimate(pair: Any) -> None:
    """Six metres to its east by its own estimate are inside the fence's north side."""
    pair.blind = ("real",)
    pair.apply(pair.core.apply(AnchorAt("real", (-2.0, 0.0, 0.0), -math.pi / 2), pair.t_s))
    far = mavlink.MAVLink_local_position_ned_message(0, 50.0, 0, -2, 0, 0, 0)
    twins = pair.vehicles["twin"].codec.pack(far)
    pair.apply(pair.core.from_vehicle("twin", twins, pair.t_s + 0.5))
    for east_m, latched in ((6.0, None), (8.0, "fence")):
        message = mavlink.MAVLink_local_position_ned_message(0, 0, east_m, -2, 0, 0, 0)
        frame = pair.vehicles["real"].codec.pack(message)
        pair.apply(pair.core.from_vehicle("real", frame, pair.t_s + 0.5))
        assert pair.core.latched == latched


def test_a_vehicle_is_received_by_its_own_system_only(pair: Any) -> None:
    pair.vehicles["real"].mute = True
    stranger = pair.vehicles["twin"].heartbeat()

    def talk() -> None:
        pair.apply(pair.core.from_vehicle("real", stranger, pair.t_s))

    pair.fly(5.0, each=talk)
    assert pair.core.latched == "lost"


def test_hold_and_resume(pair: Any) -> None:
    pair.apply(pair.core.apply(OperatorAction(OperatorCommand("hold", "anna")), pair.t_s))
    pair.fly(5.0)
    assert {v.mode for v in pair.vehicles.values()} == {FlightMode.HOLD}
    assert to_orchestrator(pair, "real", setpoint()) == ()
    assert pair.core.latched is None
    pair.apply(pair.core.apply(OperatorAction(OperatorCommand("resume", "anna")), pair.t_s))
    assert to_orchestrator(pair, "real", setpoint())
    to_orchestrator(pair, "real", mode_command(FlightMode.GUIDED))
    pair.fly(5.0)
    assert pair.core.latched is None
    assert pair.kinds() == ["hold", "dropped", "resume"]


def test_a_hold_that_is_seen_only_after_the_resume_is_no_failsafe(pair: Any) -> None:
    """Heartbeats come once a second, and a radio is late."""
    for kind in ("hold", "resume"):
        pair.apply(pair.core.apply(OperatorAction(OperatorCommand(kind, "anna")), pair.t_s))
    pair.fly(2.0)
    assert {v.mode for v in pair.vehicles.values()} == {FlightMode.HOLD}
    assert (pair.core.latched, pair.kinds()) == (None, ["hold", "resume"])
    for name in pair.vehicles:
        to_orchestrator(pair, name, mode_command(FlightMode.GUIDED))
    pair.fly(5.0)
    pair.vehicles["real"].mode = FlightMode.HOLD
    pair.fly(1.1)
    assert pair.core.latched == "failsafe"


@pytest.mark.parametrize("mode", [FlightMode.LAND, FlightMode.RTL])
def test_a_failsafe_right_after_a_resume_is_seen(pair: Any, mode: FlightMode) -> None:
    for kind in ("hold", "resume"):
        pair.apply(pair.core.apply(OperatorAction(OperatorCommand(kind, "anna")), pair.t_s))
    pair.vehicles["real"].mode = mode
    pair.fly(1.1)
    assert pair.core.latched == "failsafe"


@pytest.mark.parametrize("name", ["real", "twin"])
@pytest.mark.parametrize("mode", [FlightMode.LAND, FlightMode.RTL])
def test_a_failsafe_of_a_held_vehicle_is_supervised_not_fought(
    pair: Any, name: str, mode: FlightMode
) -> None:
    """real is a PX4, twin an ArduCopter, which starts such a failsafe only once."""
    pair.apply(pair.core.apply(OperatorAction(OperatorCommand("hold", "anna")), pair.t_s))
    pair.fly(5.0)
    held = pair.vehicles[name]
    held.mode, held.critical, held.north_m_s = mode, True, -0.5
    before = len(held.heard)
    pair.fly(0.6)
    assert pair.core.latched == "failsafe"
    assert {word for _, word in held.heard[before:]} <= {"HEARTBEAT"}
    held.mode = FlightMode.LAND
    pair.fly(20.0)
    assert pair.core.all_down
    assert "HOLD" not in [word for _, word in held.heard[before:]]
    assert pair.kinds() == ["hold", "failsafe"]


@pytest.mark.parametrize("name", ["real", "twin"])
def test_a_landing_requested_before_the_hold_may_be_seen_after_it(pair: Any, name: str) -> None:
    vehicle = pair.vehicles[name]
    autopilot, target = vehicle.autopilot, vehicle.target
    vehicle.ignores = frozenset({FlightMode.HOLD})
    to_orchestrator(pair, name, DRIVER.pack(autopilot.set_mode(target, FlightMode.LAND)))
    pair.apply(pair.core.apply(OperatorAction(OperatorCommand("hold", "anna")), pair.t_s))
    pair.fly(0.2)
    assert pair.core.latched is None
    vehicle.ignores = frozenset()
    pair.fly(2.0)
    assert vehicle.mode is FlightMode.HOLD
    assert pair.core.latched is None


def test_abort_wins_over_hold_and_nothing_resumes_it(pair: Any) -> None:
    pair.apply(pair.core.apply(OperatorAction(OperatorCommand("hold", "anna")), pair.t_s))
    pair.fly(1.0)
    abort(pair)
    pair.apply(pair.core.apply(OperatorAction(OperatorCommand("resume", "anna")), pair.t_s))
    assert to_orchestrator(pair, "real", setpoint()) == ()
    pair.fly(20.0)
    assert pair.core.all_down
    assert pair.kinds() == ["hold", "abort", "refused", "dropped"]


def test_a_hold_after_an_abort_is_refused(pair: Any) -> None:
    abort(pair)
    for kind in ("hold", "resume"):
        pair.apply(pair.core.apply(OperatorAction(OperatorCommand(kind, "anna")), pair.t_s))
    assert pair.kinds() == ["abort", "refused", "refused"]
    assert not pair.core.paused


def test_a_resume_of_nothing_is_refused(pair: Any) -> None:
    pair.apply(pair.core.apply(OperatorAction(OperatorCommand("resume", "anna")), pair.t_s))
    assert pair.kinds() == ["refused"]


@pytest.mark.parametrize(("system", "component"), [(1, 100), (7, 1)])
def test_a_vehicle_is_of_one_system_and_one_component(
    pair: Any, system: int, component: int
) -> None:
    """Another component's frames are none of its own, however many they are."""
    codec = MavlinkCodec(system_id=system, component_id=component)
    kind = (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4)
    received_s = pair.core.last_received_s("real")
    for number in range(40):
        mode = px4_custom_mode(4, 5 if number % 2 else 3)
        message = mavlink.MAVLink_heartbeat_message(*kind, 129, mode, 5, 3)
        beat = codec.pack(message)
        outputs = pair.core.from_vehicle("real", beat, pair.t_s)
        assert outputs == (ToOrchestrator("real", (beat,)),)
    assert pair.core.last_received_s("real") == received_s
    pair.fly(3.0)
    assert pair.core.latched is None


@pytest.mark.parametrize(
    ("kind", "flown_by"),
    [
        (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID),
        (mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID),
        (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
        (mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_PX4),
    ],
)
def test_a_foreign_heartbeat_is_no_state_and_no_sign_of_life(
    pair: Any, kind: int, flown_by: int
) -> None:
    """It would say disarmed, RTL (px4: MANUAL), critical: a takeover, a failsafe, or a landing."""
    codec = MavlinkCodec(system_id=1, component_id=1)
    for base_mode, mode, status in ((0, 0, 4), (129, 6, 4), (129, 1 << 16, 5)):
        beat = codec.pack(
            mavlink.MAVLink_heartbeat_message(kind, flown_by, base_mode, mode, status, 3)
        )
        assert pair.core.from_vehicle("real", beat, pair.t_s) == (ToOrchestrator("real", (beat,)),)
        assert pair.core.may_be_armed(pair.t_s + 2.0) == ("real", "twin")
    pair.fly(3.0)
    assert pair.core.latched is None
    received_s = pair.core.last_received_s("real")
    pair.core.from_vehicle("real", beat, pair.t_s + 1.0)
    assert pair.core.last_received_s("real") == received_s
