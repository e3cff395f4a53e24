"""Between runs on hardware: whether a vehicle flies back by itself, which way, how it ends."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.conftest import ROOT, NoCommands
from tests.orchestrator.flights import all_landed, log_of
from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.campaigns.setup.case_setup import ObserverSetup
from wil_campaign.foundation.files.documents import parse_document
from wil_campaign.orchestrator.campaign.between_runs import BetweenRuns
from wil_campaign.orchestrator.campaign.workers.run_order import fly_order
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.run.stages.return_flight import return_setup
from wil_campaign.orchestrator.run_results.run_result import LaterEvent, RunResult, SyncResult
from wil_campaign.orchestrator.state.return_path import (
    CLEAR_M,
    ReturnPath,
    StandingPose,
    offset_from_start_text,
    read_standing_pose,
    why_no_return,
    why_path_blocked,
)
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.vehicles.embedded.physics.contact_world import BODY
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.world_file.world import World

CAMPAIGN = """\
schema: wil/campaign/1
campaign: hop
vehicles:
  real: {link: LINK, autopilot: px4, start: {north_m: 1, east_m: -1, yaw_deg: 30}}
world: world.yaml
autonomy: {use: straight, with: {speed_m_s: 1.0, for_s: 2.0}}
goal: {altitude_m: 1.2}
modes: [real]
repetitions: 2
between_runs: fly_back
geofence: {box: {north_m: [-6, 8], east_m: [-6, 6], up_m: [-0.5, 4]}}
oracles: {landed: {}}
"""
WORLD = """\
schema: wil/world/1
origin: {latitude_deg: 47.4, longitude_deg: 8.5}
objects:
  pillar:
    shape: {box: {size_m: [0.4, 0.4, 3]}}
    pose: {north_m: 3, east_m: 4, up_m: 1.5}
    exists_in: {real: W}
  shelf:
    shape: {box: {size_m: [1, 1, 0.1]}}
    pose: {north_m: -3, east_m: -3, up_m: 0.7}
    exists_in: {real: W}
  block:
    shape: {box: {size_m: [1, 1, 0.2]}}
    pose: {north_m: 3, east_m: -3, up_m: 0.1}
    exists_in: {real: W}
"""
START = Pose.of(1.0, -1.0, 0.0, yaw_rad=math.radians(30.0))
ATTACHED = "udpin://127.0.0.1:14555"
STOOD = Pose.of(4.0, 3.0, 0.0, yaw_rad=0.4)
FENCE = Fence.box(north_m=(-6, 8), east_m=(-6, 6), up_m=(-0.5, 4))


@pytest.fixture
def hop(tmp_path: Path) -> Callable[..., Campaign]:
    def make(link: str = ATTACHED, *changes: tuple[str, str]) -> Campaign:
        text = CAMPAIGN.replace("LINK", f'"{link}"')
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "world.yaml").write_text(WORLD)
        (tmp_path / "hop.yaml").write_text(text)
        return load_campaign(tmp_path / "hop.yaml")

    return make


def result(**fields: Any) -> RunResult:
    given: dict[str, Any] = {
        "case": "default",
        "mode": "real",
        "rep": 1,
        "seed": 1,
        "verdict": "PASS",
        "also": (),
        "reason": "",
        "required": True,
        "duration_s": 9.0,
        "wall_s": 9.0,
        "oracles": (),
        "sync": SyncResult(),
        "mixing": None,
    }
    return RunResult(**{**given, **fields})


def way(stand: Pose = STOOD, start: Pose = START, altitude_m: float = 1.2) -> ReturnPath:
    return ReturnPath(stand=stand, start=start, altitude_m=altitude_m, speed_m_s=0.8)


def test_it_flies_back_and_stands_at_its_start(
    hop: Callable[..., Campaign], tmp_path: Path
) -> None:
    campaign = hop("embedded")
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path / "o" / "run", clock="virtual")
    assert fly_order(order, lambda _: None, NoCommands()).verdict == "PASS"
    stand = read_standing_pose(order.folder, "real")
    assert stand is not None
    away = offset_from_start_text(stand, START)
    assert away is not None
    assert away[0] > 1.5
    back = replace(order, back=way(stand.pose), folder=tmp_path / "o" / "back")
    came = fly_order(back, lambda _: None, NoCommands())
    assert (came.case, came.verdict, came.required) == ("default-real-back", "PASS", False)
    away = offset_from_start_text(read_standing_pose(back.folder, "real"), START)
    assert away is not None
    assert away[0] < 0.15
    assert away[1] < 3.0
    assert all_landed(back.folder)
    kinds = [line["stage"] for line in log_of(back.folder) if line["event"] == "stage"]
    assert kinds[-3:] == ["land", "landed", "end"]
    assert (back.folder / "run.mcap").exists()
    assert (back.folder / "real.tlog").exists()


def test_the_guard_keeps_the_fence_on_the_way_back_too(
    hop: Callable[..., Campaign], tmp_path: Path
) -> None:
    campaign = hop("embedded")
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path / "o" / "run", clock="virtual")
    outside = way(Pose.of(4.0, 3.0, 0.0), Pose.of(4.0, 12.0, 0.0))
    came = fly_order(replace(order, back=outside), lambda _: None, NoCommands())
    assert came.verdict == "FAIL"
    assert "real" in came.reason
    assert all_landed(order.folder)


LANDED = StandingPose(STOOD, armed=False, stage="end")
ARMED = {"event": "stage", "stage": "arm"}


@pytest.mark.parametrize(
    ("ended", "stand", "log", "why"),
    [
        (result(), LANDED, [], ""),
        (result(verdict="FAIL", reason="late"), LANDED, [], ""),
        (result(verdict="INVALID", reason="mixing"), LANDED, [], ""),
        (result(verdict="ABORTED", reason="by anna"), LANDED, [], "ended as ABORTED: by anna"),
        (result(verdict="ERROR", reason="lost"), LANDED, [], "ended as ERROR: lost"),
        (
            result(
                verdict="FAIL", also=(LaterEvent("ERROR", "real still has its parameters", 9.0),)
            ),
            LANDED,
            [],
            "ERROR after the verdict FAIL: real still has its parameters",
        ),
        (result(verdict="FAIL", also=(LaterEvent("INVALID", "mixing", 9.0),)), LANDED, [], ""),
        (result(), None, [], "its position is unknown"),
        (result(), replace(LANDED, armed=True), [], "not landed and disarmed"),
        (result(), replace(LANDED, stage="land"), [], "not landed and disarmed"),
        (
            result(verdict="FAIL"),
            LANDED,
            [{"event": "guard", "kind": "failsafe", "text": "real: RTL"}],
            "the guard took over: real: RTL",
        ),
        (result(), LANDED, [{"event": "guard", "kind": "fence", "text": "real left it"}], ""),
        (
            result(),
            LANDED,
            [ARMED, {"event": "vehicle", "vehicle": "real", "kind": "fault", "text": "EKF"}],
            "real reported a fault: EKF",
        ),
        (
            result(),
            LANDED,
            [{"event": "vehicle", "vehicle": "real", "kind": "fault", "text": "EKF"}, ARMED],
            "",
        ),
        (
            result(collisions=(Flag(3.0, "collision", "real", "real touched pillar"),)),
            LANDED,
            [],
            "real touched pillar, a real object",
        ),
        (result(collisions=(Flag(3.0, "collision", "real", "real touched gate"),)), LANDED, [], ""),
    ],
)
def test_the_end_of_a_run_decides_whether_it_flies_back(
    ended: RunResult, stand: StandingPose | None, log: list[dict[str, Any]], why: str
) -> None:
    said = why_no_return(ended, stand, log, solid={"pillar"})
    assert (why in said) if why else said == ""


@pytest.mark.parametrize(
    ("back", "why"),
    [
        (way(), ""),
        (way(altitude_m=4.5), "the path leaves the fence at its ceiling"),
        (way(STOOD, Pose.of(9.0, 0.0, 0.0)), "the path leaves the fence at its north side"),
        (way(Pose.of(3.0, 5.5, 0.0)), "pillar is nearer than 0.5 m to the path"),
        (way(Pose.of(3.0, 5.5, 0.0), altitude_m=3.9), ""),
        (way(Pose.of(-3.0, -3.0, 0.0), altitude_m=2.2), "shelf is nearer than 0.5 m to the path"),
        (way(STOOD, Pose.of(-3.0, -3.2, 0.0), 2.2), "shelf is nearer than 0.5 m to the path"),
        (way(Pose.of(3.0, -3.0, 0.2)), ""),
        (way(STOOD, Pose.of(3.0, -3.0, 0.2)), ""),
        (way(Pose.of(3.0, -3.0, 0.2), altitude_m=0.75), ""),
    ],
)
def test_a_blocked_way_back_is_refused_with_the_reason(back: ReturnPath, why: str) -> None:
    scene = World.parse(parse_document(WORLD.encode(), name="world.yaml")).scene("real", "W")
    probe = ClearanceProbe(scene, BODY, floors=False, within_m=CLEAR_M)
    assert why_path_blocked(back, fence=FENCE, keep_m=0.0, probe=probe) == why


class Asked:
    """Stands in for the person."""

    def __init__(self) -> None:
        self.count = 0
        self.elsewhere = ""

    def ask(self, elsewhere: str = "") -> None:
        self.count += 1
        self.elsewhere = elsewhere


def between(
    campaign: Campaign, folder: Path, hardware: str = ""
) -> tuple[BetweenRuns, Asked, list[str]]:
    asked, said = Asked(), list[str]()
    made = BetweenRuns(
        campaign=campaign,
        folder=folder,
        hardware=hardware,
        repositioning=asked,
        say=said.append,
    )
    return made, asked, said


def landed_at(folder: Path, pose: Pose) -> None:
    folder.mkdir(parents=True)
    north_m, east_m, down_m = pose.position_ned_m
    (folder / "trajectory.csv").write_text(
        "t_s,vehicle,stage,armed,est_north_m,est_east_m,est_down_m,est_yaw_rad\n"
        f"1.0,real,landed,0,{north_m},{east_m},{down_m},{pose.yaw_rad}\n"
    )
    (folder / "log.jsonl").write_text(json.dumps(ARMED) + '\n{"cut')


def test_a_flight_back_is_ordered_and_looked_at(
    hop: Callable[..., Campaign], tmp_path: Path
) -> None:
    campaign = hop()
    made, asked, said = between(campaign, tmp_path / "o")
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path / "o" / "run", clock="wall")
    landed_at(order.folder, STOOD)
    back = made.after(order, result())
    assert back is not None
    assert back.folder == tmp_path / "o" / "back" / "default" / "real" / "1"
    assert back.back is not None
    assert back.back.stand.position_ned_m == STOOD.position_ned_m
    assert back.back.stand.yaw_rad == pytest.approx(STOOD.yaw_rad)
    assert (back.back.start, back.back.altitude_m) == (START, 1.2)
    landed_at(back.folder, Pose.of(1.1, -1.0, 0.0, yaw_rad=START.yaw_rad))
    made.check_return(back, result())
    assert asked.count == 0
    assert said == ["real is back at its start, 0.10 m and 0 degrees off"]


@pytest.mark.parametrize("do", ["fly_back", "ask"])
@pytest.mark.parametrize("flown", [True, False])
def test_a_person_moves_the_vehicle_where_the_next_run_starts_elsewhere(
    hop: Callable[..., Campaign], tmp_path: Path, do: str, flown: bool
) -> None:
    """Else its world would be shifted and turned, and its fence: it starts where it stands."""
    cases = "{moved: {vehicles.real.start: {north_m: 2, east_m: -1, yaw_deg: 90}}, last: {}}"
    changes = ("repetitions: 2", f"repetitions: 1\ncases: {cases}"), ("fly_back", do)
    campaign = hop(ATTACHED, *changes)
    made, asked, said = between(campaign, tmp_path / "o")
    moved, last = campaign.plans
    order = RunOrder(plan=moved, folder=tmp_path / "o" / "run", clock="wall")
    landed_at(order.folder, STOOD)
    assert made.after(order, result(), coming=[last], flown=flown) is None
    elsewhere = "north 1 m, east -1 m, up 0 m, heading 30 degrees for real"
    assert (asked.count, asked.elsewhere) == (1, elsewhere)
    why = f"the next run starts elsewhere, at {elsewhere}"
    refused = [f"moved/real/1: the vehicle does not fly back: {why}"]
    assert said == (refused if do == "fly_back" else [])
    order = RunOrder(plan=last, folder=tmp_path / "o" / "run", clock="wall")
    back = made.after(order, result(), coming=[last], flown=flown)
    assert (back is not None) == (flown and do == "fly_back")


def test_the_flight_back_after_a_run_that_was_flown_again_is_flown_as_well(
    hop: Callable[..., Campaign], tmp_path: Path
) -> None:
    """In the folder of the first, its result would be taken for that of the second."""
    campaign = hop()
    made, _, _ = between(campaign, tmp_path / "o")
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path / "o" / "run", clock="wall")
    landed_at(order.folder, STOOD)
    folders = []
    for _ in range(3):
        back = made.after(order, result())
        assert back is not None
        assert not back.folder.exists()
        landed_at(back.folder, START)
        folders.append(back.folder.relative_to(tmp_path / "o" / "back" / "default" / "real"))
    assert folders == [Path("1"), Path("1-2"), Path("1-3")]


@pytest.mark.parametrize(
    ("outcome", "stands", "why"),
    [
        (
            result(),
            Pose.of(2.0, -1.0, 0.0, yaw_rad=START.yaw_rad),
            "it is 1.00 m and 0 degrees",
        ),
        (result(), Pose.of(1.0, -1.0, 0.0), "it is 0.00 m and 30 degrees off"),
        (result(verdict="ERROR", reason="preflight: battery"), START, "ERROR, preflight: battery"),
        (WorkerLost("its process died"), START, "the flight was lost: its process died"),
    ],
)
def test_a_person_is_asked_for_a_vehicle_that_did_not_come_back(
    hop: Callable[..., Campaign],
    tmp_path: Path,
    outcome: RunResult | WorkerLost,
    stands: Pose,
    why: str,
) -> None:
    campaign = hop()
    made, asked, said = between(campaign, tmp_path / "o")
    folder = tmp_path / "o" / "back"
    landed_at(folder, stands)
    order = RunOrder(plan=campaign.runs[0], folder=folder, clock="wall", back=way())
    made.check_return(order, outcome)
    assert asked.count == 1
    assert why in said[-1]


def test_a_person_is_asked_when_the_vehicle_must_not_fly_back(
    hop: Callable[..., Campaign], tmp_path: Path
) -> None:
    campaign = hop()
    made, asked, said = between(campaign, tmp_path / "o")
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path / "o" / "run", clock="wall")
    landed_at(order.folder, STOOD)
    assert made.after(order, result(verdict="ERROR", reason="real was not heard")) is None
    assert asked.count == 1
    why = "the run ended as ERROR: real was not heard"
    assert said == [f"default/real/1: the vehicle does not fly back: {why}"]


def test_a_vehicle_at_its_start_stays_there(hop: Callable[..., Campaign], tmp_path: Path) -> None:
    campaign = hop()
    made, asked, said = between(campaign, tmp_path / "o")
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path / "o" / "run", clock="wall")
    landed_at(order.folder, START)
    assert made.after(order, result()) is None
    assert (asked.count, said) == (0, [])


@pytest.mark.parametrize(
    ("made_of", "hardware", "asked_for"),
    [
        ((ATTACHED, ("fly_back", "ask")), "", 1),
        ((ATTACHED, ("between_runs: fly_back\n", "")), "real", 1),
        ((ATTACHED, ("between_runs: fly_back\n", "")), "", 0),
        (("embedded",), "", 0),
    ],
)
def test_a_person_is_asked_as_campaign_and_hardware_require(
    hop: Callable[..., Campaign],
    tmp_path: Path,
    made_of: tuple[Any, ...],
    hardware: str,
    asked_for: int,
) -> None:
    campaign = hop(*made_of)
    made, asked, _ = between(campaign, tmp_path / "o", hardware)
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path / "o" / "run", clock="wall")
    landed_at(order.folder, STOOD)
    assert made.after(order, result()) is None
    assert asked.count == asked_for


@pytest.mark.parametrize(
    ("hardware", "mode", "asked_for"),
    [("intruder", "real", 1), ("intruder", "sim", 0), ("", "real", 0)],
)
def test_a_person_puts_an_attached_actor_back_where_it_flew(
    tmp_path: Path, hardware: str, mode: str, asked_for: int
) -> None:
    fence = "{box: {north_m: [-1.5, 3.5], east_m: [-1, 1], up_m: [-0.5, 2.3]}}"
    link = "link: 'udpin://0.0.0.0:14560', autopilot: px4, virtual: embedded"
    sets = (f"actors={{intruder: {{{link}, geofence: {fence}}}}}", "controls={}")
    options = ExpansionOptions(cases=("fast",), modes=(mode,), sets=sets)
    campaign = load_campaign(ROOT / "campaigns" / "avoid.yaml", options)
    made, asked, _ = between(campaign, tmp_path / "o", hardware)
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path / "o" / "run", clock="wall")
    landed_at(order.folder, STOOD)
    assert made.after(order, result()) is None
    assert asked.count == asked_for


def test_nothing_flies_back_with_an_actor_beside_it(tmp_path: Path) -> None:
    faults = "faults={real: {pose_source: {stop: {on: goal}}}}"
    sets = ("actors={intruder: {link: embedded, autopilot: px4}}", "controls={}", faults)
    campaign = load_campaign(
        ROOT / "campaigns" / "avoid.yaml",
        ExpansionOptions(cases=("fast",), modes=("real",), sets=sets),
    )
    order = RunOrder(plan=campaign.runs[0], folder=tmp_path, clock="virtual")
    setup = RunSetup.of(order)
    assert [one.name for one in setup.guarded] == ["real", "intruder"]
    back = return_setup(setup, way())
    assert [one.name for one in back.guarded] == ["real"]
    assert (len(setup.case.faults), back.case.faults) == (1, ())


class FliesBy(ObserverSetup):
    def on_the_way_back(self) -> ObserverSetup:
        return self


def test_a_flight_back_has_the_observers_that_the_vehicle_flies_by(tmp_path: Path) -> None:
    campaign = load_campaign(ROOT / "campaigns" / "gate.yaml", ExpansionOptions(modes=("wil",)))
    setup = RunSetup.of(RunOrder(plan=campaign.runs[0], folder=tmp_path, clock="virtual"))
    fed = FliesBy()
    observers = {"outlets": ObserverSetup(), "inject": fed}
    setup = replace(setup, case=replace(setup.case, observers=observers))
    assert return_setup(setup, way()).case.observers == {"inject": fed}
