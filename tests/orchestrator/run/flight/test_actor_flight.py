"""Runs in which a vehicle of its own flies as the intruder of the world."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tests.orchestrator.conftest import ROOT, Fly
from tests.orchestrator.flights import all_landed, log_of
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.clocks.virtual_loop import run_on_clock, run_virtual
from wil_campaign.foundation.files.document_writer import to_json, write_atomically
from wil_campaign.orchestrator.campaign.reevaluation import judge_run_again
from wil_campaign.orchestrator.reading.judged_motion import read_judged_motion
from wil_campaign.orchestrator.run.stages.actor_flight import ActorFlight
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run.vehicles.vehicle_backends import vehicle_seed
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.safety.guard.core.commands import StartOutage
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.safety.model.verdict import DecisiveEvent
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.motion import ObjectMotion, StartAtTime, Waypoint

FLOWN = "actors={intruder: {link: embedded, autopilot: px4}}"
BLIND = "autonomy.with={object: person}"
COARSE = tuple(
    f"vehicles.{name}.sensors.camera.{key}={value}"
    for name in ("real", "twin")
    for key, value in (("width_px", 160), ("height_px", 120), ("rate_hz", 5))
)
SETS = (FLOWN, BLIND, *COARSE, "recipe.sensors.camera.rate_hz=5")


def test_the_intruder_touches_a_vehicle_that_does_not_evade(fly_run: Fly) -> None:
    result, folder = fly_run("avoid", "fast", "sim", sets=SETS)
    assert (result.verdict, result.decided_by) == ("FAIL", "collision/twin"), result.reason
    (actor,) = result.actors
    assert actor.delay_s is not None
    assert actor.offset_m is not None
    assert 0.0 < actor.delay_s < 3.0
    assert 0.0 < actor.offset_m < 0.5
    assert {"intruder.tlog", "twin.tlog"} <= set(result.artifacts)
    # It flew by itself: not once exactly where the world file's motion has it.
    track = read_judged_motion(folder / "judged.msgpack").world_events.tracks["intruder"]
    assert track.travel(0.0, result.oracles[0].at_s or 60.0).length_m > 2.5
    phases = [one for one in log_of(folder) if one.get("vehicle") == "intruder"]
    assert phases[-1]["text"] == "intruder: down: it is disarmed" or any(
        phase.get("kind") == "disarmed" for phase in phases
    )
    # Judged again from the recording alone, it is touched at the same moment.
    plan = load_campaign(
        ROOT / "campaigns" / "avoid.yaml",
        ExpansionOptions(cases=("fast",), modes=("sim",), sets=(*SETS, "controls={}")),
    ).runs[0]
    write_atomically(folder / "result.json", to_json(asdict(result)))
    again = judge_run_again(plan, folder).now
    touched = {oracle.name: oracle for oracle in result.oracles}["collision"]
    assert {oracle.name: oracle for oracle in again.oracles}["collision"] == touched
    assert again.verdict == "FAIL"


def test_equal_runs_with_an_actor_are_equal_to_the_byte(fly_run: Fly) -> None:
    flown = [fly_run("avoid", "fast", "sim", sets=SETS)[1] for _ in range(2)]
    one, other = ((folder / "judged.msgpack").read_bytes() for folder in flown)
    assert one == other


def test_a_contact_with_the_actor_in_mode_real_fails_the_run(fly_run: Fly) -> None:
    result, _ = fly_run("avoid", "fast", "real", sets=SETS)
    assert result.verdict == "FAIL"
    assert "touched intruder" in result.reason


def mute(pair: VehiclePair, run_state: RunState) -> None:
    run_state.on_stage(
        lambda stage, _: pair.guard.send(StartOutage("intruder", 60.0)) if stage == "goal" else None
    )


@pytest.mark.parametrize("autonomy", [BLIND, "autonomy.with={for_s: 4}"])
def test_a_run_whose_actor_is_lost_never_passes(fly_run: Fly, autonomy: str) -> None:
    result, _ = fly_run("avoid", "fast", "sim", sets=(*SETS, autonomy), disturb=mute)
    assert result.verdict == "ERROR", result.reason
    assert "intruder" in result.reason


def test_an_actor_that_leaves_its_fence_lands_and_is_no_fault_of_the_subject(fly_run: Fly) -> None:
    tight = "{box: {north_m: [-0.81, 3], east_m: [-1, 1], up_m: [-0.5, 2.3]}}"
    sets = (*SETS, f"actors.intruder.geofence={tight}", "vehicles.twin.start.east_m=1.2")
    result, folder = fly_run("avoid", "fast", "sim", sets=sets)
    assert (result.verdict, result.decided_by) == ("ERROR", "guard.alone/intruder"), result.reason
    assert "intruder cannot stop before the fence's" in result.reason
    assert [one.outcome for one in result.preflight if one.check == "home"] == ["ok", "ok"]
    kinds = [one.get("kind") for one in log_of(folder) if one.get("vehicle") == "intruder"]
    assert kinds.index("disarmed") > kinds.index("alone")
    assert all_landed(folder)


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        ("max_delay_s=0.5", "behind its motion"),
        ("max_offset_m=0.01", "off its"),
        ("max_silence_s=0.001", "has sent no pose for 0.001 s (max_silence_s)"),
    ],
)
def test_an_actor_that_does_not_fly_its_motion_makes_the_run_invalid(
    fly_run: Fly, limit: str, said: str
) -> None:
    result, _ = fly_run("avoid", "fast", "sim", sets=(*SETS, f"actors.intruder.{limit}"))
    assert (result.verdict, result.decided_by) == ("INVALID", "actor/intruder"), result.reason
    assert said in result.reason


def test_no_two_vehicles_of_a_run_have_one_seed_and_each_fits_a_message() -> None:
    for seed in (0, 1, 2**63 - 1):
        seeds = [vehicle_seed(seed, name) for name in ("real", "twin", "intruder", "other")]
        assert len(set(seeds)) == 4
        assert all(0 <= one < 2**64 for one in seeds)


def test_an_actor_that_is_slower_than_its_motion_makes_the_run_invalid(fly_run: Fly) -> None:
    slow = ("actors.intruder.max_delay_s=3", "actors.intruder.params={MPC_XY_VEL_MAX: 0.3}")
    result, _ = fly_run("avoid", "fast", "sim", sets=(*SETS, *slow, "autonomy.with={for_s: 12}"))
    assert (result.verdict, result.decided_by) == ("INVALID", "actor/intruder"), result.reason
    assert "behind its motion (max_delay_s 3)" in result.reason


MOTION = ObjectMotion(
    Pose.of(0.0, 0.0, 0.0), (Waypoint((0, 0, -1), 1.0), Waypoint((8, 0, -1), 1.0)), StartAtTime(2.0)
)


async def _watched(
    stops_s: float, silent_s: float, land_s: float, spoil: Callable[[float, Pose], Pose]
) -> list[DecisiveEvent]:
    """Watch an actor that stays in its place from one time on, and is silent from another on.

    spoil: what it reports at a time in place of its pose.
    """
    loop = asyncio.get_running_loop()
    t0_s = loop.time()
    run_state = RunState(time=loop.time)
    took: list[Callable[[PoseSample], None]] = []

    async def lands(*_: object) -> None:
        await asyncio.sleep(2.0)

    lasting_s = iter((2.0, 60.0))

    async def through(_: object) -> None:
        """It lifts off as the motion begins; from then on it is guided."""
        await asyncio.sleep(next(lasting_s))

    driver = SimpleNamespace(
        on_failure=lambda _: None,
        enter_guided=None,
        estimate=None,
        send=lambda _: None,
        land=lands,
        disarmed=lands,
        state=SimpleNamespace(armed=True),
    )
    setup: Any = SimpleNamespace(
        name="intruder",
        autopilot="px4",
        motion=replace(MOTION, start=StartAtTime(t0_s + 2.0)),
        max_delay_s=3.0,
        max_offset_m=0.5,
        max_silence_s=0.5,
    )
    context: Any = SimpleNamespace(on_pose=took.append, driver=driver)
    hold: Any = SimpleNamespace(through=through)
    sync: Any = SimpleNamespace(landing_timeout_s=20.0)
    flight = ActorFlight(
        setup=setup,
        context=context,
        run_state=run_state,
        operator_hold=hold,
        sync=sync,
        events={},
        report_pose=lambda _: None,
        send_anchors=lambda: None,
    )
    flying = asyncio.create_task(flight.fly())
    for tick in range(round(20.0 * 20)):
        now_s = 0.05 * tick
        if now_s < silent_s:
            place = spoil(now_s, setup.motion.pose_at(t0_s + min(now_s, stops_s), {}))
            took[0](PoseSample(t0_s + now_s, "intruder", place, (0.0, 0.0, 0.0)))
        if now_s >= land_s and not run_state.reached("land"):
            run_state.enter("land")
        await asyncio.sleep(0.05)
    await flying
    return [replace(one, t_s=one.t_s - t0_s) for one in run_state.decisive]


def _events(
    stops_s: float, silent_s: float, land_s: float, spoil: Callable[[float, Pose], Pose]
) -> list[DecisiveEvent]:
    found: list[DecisiveEvent] = []

    async def main() -> None:
        found.extend(await _watched(stops_s, silent_s, land_s, spoil))

    run_on_clock("virtual", main())
    return found


def _hovering(t_s: float, pose: Pose) -> Pose:
    """Return the pose of a vehicle that is never quite still."""
    return replace(pose, q_wxyz=(1.0, 1e-6 * (round(t_s / 0.05) % 2), 0.0, 0.0))


@pytest.mark.parametrize(
    ("stops_s", "silent_s", "land_s", "said", "at_s"),
    [
        (99.0, 99.0, 12.0, "", 0.0),
        (5.0, 99.0, 14.0, "is 3.1 s behind its motion (max_delay_s 3)", 8.1),
        (5.0, 99.0, 7.0, "", 0.0),
        (99.0, 8.0, 12.0, "has sent no pose for 0.5 s (max_silence_s)", 8.5),
        (99.0, 13.0, 12.0, "has sent no pose for 0.5 s (max_silence_s)", 13.5),
        (99.0, 16.5, 12.0, "", 0.0),
    ],
)
def test_an_actor_that_stops_or_falls_silent_makes_the_run_invalid(
    stops_s: float, silent_s: float, land_s: float, said: str, at_s: float
) -> None:
    """It stays in its place, or is silent: also until it has landed."""
    found = _events(stops_s, silent_s, land_s, _hovering)
    assert [one.kind for one in found] == (["INVALID"] if said else [])
    if said:
        assert said in found[0].text
        assert found[0].t_s == pytest.approx(at_s, abs=0.15)


def test_an_actor_whose_pose_is_frozen_makes_the_run_invalid() -> None:
    """The object stayed where no vehicle was: contacts with that were missed, PASS."""
    (found,) = _events(5.0, 99.0, 14.0, lambda _, pose: pose)
    assert found.kind == "INVALID"
    assert "has repeated one pose for 0.5 s (max_silence_s)" in found.text
    assert found.t_s == pytest.approx(5.5, abs=0.15)


def test_an_actor_may_rest_on_the_ground() -> None:
    on_ground = Pose((0.0, 0.0, 0.0))

    def landing(t_s: float, pose: Pose) -> Pose:
        return _hovering(t_s, pose) if t_s < 12.5 else on_ground

    assert not _events(99.0, 99.0, 12.0, landing)


def test_an_actor_whose_place_is_no_number_makes_the_run_invalid() -> None:
    """It reached the oracles, which raised: an ERROR of the test itself."""
    lost = Pose((math.nan, 0.0, -1.0))
    (found,) = _events(99.0, 99.0, 14.0, lambda t_s, pose: lost if t_s >= 6.0 else pose)
    assert found.kind == "INVALID"
    assert found.t_s == pytest.approx(6.0, abs=0.15)
    assert "is at no place: its pose is not finite" in found.text


@pytest.mark.parametrize("is_held", [False, True])
def test_an_actor_that_somebody_else_flies_is_not_taken_for_one_that_took_off(
    is_held: bool,
) -> None:
    """After an operator's hold it may be in the air, by its own takeoff."""
    asked: list[str] = []

    class Driver:
        state = SimpleNamespace(landed="on_ground" if is_held else "in_air")

        def on_failure(self, _: object) -> None:
            pass

        async def arm(self) -> None:
            asked.append("arm")
            if not is_held:
                raise VehicleError("it is armed already, by somebody else")

        async def begin_takeoff(self, _: float) -> None:
            asked.append("takeoff")
            self.state = SimpleNamespace(landed="in_air")

    setup: Any = SimpleNamespace(name="intruder", autopilot="px4", motion=MOTION)
    context: Any = SimpleNamespace(
        on_pose=lambda _: None, driver=Driver(), height_m=lambda: 1.0 if is_held else 0.0
    )

    async def take_off() -> None:
        flight = ActorFlight(
            setup=setup,
            context=context,
            run_state=RunState(time=asyncio.get_running_loop().time),
            operator_hold=cast("Any", None),
            sync=cast("Any", SimpleNamespace(takeoff_timeout_s=9.0)),
            events={},
            report_pose=lambda _: None,
            send_anchors=lambda: None,
        )
        await flight._take_off(0.0)
        await flight._take_off(0.0)

    if is_held:
        run_virtual(take_off())
    else:
        with pytest.raises(VehicleError, match="by somebody else"):
            run_virtual(take_off())
    assert asked == (["arm", "takeoff"] if is_held else ["arm"])
