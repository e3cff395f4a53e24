"""A fence changed in flight, as both autopilots have it: uploaded, put back, by a bad radio too."""

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.conftest import BRIEF, ROOT
from tests.orchestrator.flights import all_landed, log_of
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.files.document_writer import to_json, write_atomically
from wil_campaign.orchestrator.campaign.reevaluation import judge_run_again
from wil_campaign.orchestrator.operator.run_messages import News, RunEventReport
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.safety.guard.core.commands import StartOutage
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.mavlink.framing import FrameSplitter

Fly = Callable[..., tuple[RunResult, Path]]
TIGHTER = "box: {north_m: [-0.9, 4.7], east_m: [-1.8, 1.8], up_m: [-0.5, 2.0]}"
WIDER = "box: {north_m: [-0.9, 9], east_m: [-5, 5], up_m: [-0.5, 3.5]}"
NO_WAY_HOME = "box: {north_m: [1.2, 4.7], east_m: [-1.5, 1.5], up_m: [-0.5, 2.0]}"
MIXED = ("vehicles.twin.autopilot=ardupilot", "sync.max_takeoff_skew_s=5")
AHEAD = (*BRIEF, "autonomy.with={speed_m_s: 0.4, for_s: 5}")
"""Two metres ahead, on this side of the gate: time for a fence."""
CAN_GO_DARK = "links.twin={duplicate: 1.0e-9}"
MISSION_COUNT, PARAM_SET = 44, 23


class Operator:
    """Says things some time after the goal was given; an inbox and a disturbance in one.

    East of each vehicle's fence, aboard, is looked at when it is told to land.
    """

    def __init__(self, *script: tuple[float, OperatorCommand]) -> None:
        self._script = list(script)
        self._since_s: float | None = None
        self._pair: VehiclePair | None = None
        self.answers: list[tuple[float, str, str]] = []
        self.aboard: list[Mapping[str, tuple[int, float]]] = []
        self.on_goal: Callable[[VehiclePair], None] = lambda _: None

    def __call__(self, pair: VehiclePair, run_state: RunState) -> None:
        def entered(name: Stage, t_s: float) -> None:
            if name == "goal":
                self._since_s = t_s
                self.on_goal(pair)
            if name in {"goal", "land"}:
                self.aboard.append({n: kept(v) for n, v in pair.vehicles.items()})

        self._pair = pair
        run_state.on_stage(entered)

    def poll(self) -> OperatorCommand | None:
        now_s = asyncio.get_running_loop().time()
        if self._since_s is None or not self._script or now_s < self._since_s + self._script[0][0]:
            return None
        return self._script.pop(0)[1]

    def hear(self, news: News) -> None:
        if isinstance(news, RunEventReport) and news.kind == "answer" and self._since_s is not None:
            self.answers.append((news.t_s - self._since_s, news.word, news.text))


def asks(document: str) -> OperatorCommand:
    return OperatorCommand("geofence", "anna", document=document, command_id="a1")


def kept(vehicle: Any) -> tuple[int, float]:
    """Return how far east the autopilot's own fence reaches, and how high; 0 without one."""
    assert isinstance(vehicle, EmbeddedVehicle)
    autopilot = vehicle.autopilot
    px4 = "GF_MAX_VER_DIST" in autopilot.parameters
    corners = [corner for area in autopilot.fence.areas for corner in area.corners]  # type: ignore[union-attr]  # no circle
    ceiling_m = autopilot.parameters["GF_MAX_VER_DIST" if px4 else "FENCE_ALT_MAX"]
    return round(max((east_m for _, east_m in corners), default=0.0)), round(ceiling_m, 1)


def flown(fly_run: Fly, operator: Operator, *sets: str, **more: Any) -> tuple[RunResult, Path]:
    return fly_run(
        inbox=operator, disturb=operator, report=operator.hear, sets=(*AHEAD, *sets), **more
    )


def flown_alone(fly_run: Fly, operator: Operator, *sets: str) -> tuple[RunResult, Path]:
    return flown(fly_run, operator, *sets, mode="sim")


def event_texts(folder: Path, *kinds: str) -> list[str]:
    lines = [line for line in log_of(folder) if line["event"] == "guard"]
    return [line["text"] for line in lines if line["kind"] in kinds]


def test_both_autopilots_have_the_new_fence(fly_run: Fly) -> None:
    operator = Operator((0.5, asks(TIGHTER)))
    result, folder = flown(fly_run, operator, *MIXED)
    assert (result.verdict, result.reason) == ("PASS", "")
    before, after = operator.aboard
    assert before == {"real": (4, 3.3), "twin": (4, 3.3)}
    assert after == {"real": (3, 3.0), "twin": (3, 3.0)}
    ((at_s, word, text),) = operator.answers
    assert (word, text) == ("ok", "anna changed the fence of real and twin")
    assert at_s < 2.0
    assert event_texts(folder, "proposed", "geofence") == [
        (
            "anna requests another fence for real and twin; the old one applies until the "
            "autopilot has the new one"
        ),
        "anna changed the fence of real and twin",
    ]
    (answer,) = [line for line in log_of(folder) if line["event"] == "answer"]
    assert (answer["who"], answer["ok"]) == ("anna", True)


def test_it_is_judged_again_by_the_fence_that_held_then(fly_run: Fly) -> None:
    small = ("geofence.box.north_m=[-0.8, 3.2]",)
    operator = Operator((0.2, asks(WIDER)))
    given = {"inbox": operator, "disturb": operator, "report": operator.hear}
    result, folder = fly_run(mode="sim", sets=small, **given)
    assert (result.verdict, result.reason) == ("PASS", "")
    assert [(one.by, one.vehicles) for one in result.fence_changes] == [("anna", ("twin",))]
    write_atomically(folder / "result.json", to_json(result))
    options = ExpansionOptions(cases=("large",), modes=("sim",), sets=small)
    plan = load_campaign(ROOT / "campaigns" / "gate.yaml", options).runs[0]
    rejudged = judge_run_again(plan, folder)
    assert rejudged.before == rejudged.now == result


def test_each_vehicle_may_get_one_of_its_own(fly_run: Fly) -> None:
    operator = Operator((0.5, asks(f"twin: {{{WIDER}}}")))
    result, _ = flown(fly_run, operator)
    assert (result.verdict, result.reason) == ("PASS", "")
    assert operator.aboard[-1] == {"real": (4, 3.3), "twin": (6, 4.5)}


def test_no_autopilot_keeps_a_fence_that_one_of_them_refuses(fly_run: Fly) -> None:
    # ArduCopter takes a fence that leaves its home out, PX4 does not.
    operator = Operator((3.5, asks(NO_WAY_HOME)))
    result, folder = flown(fly_run, operator, *MIXED, "autonomy.with.speed_m_s=0.8")
    assert (result.verdict, result.reason) == ("PASS", "")
    ((_, word, text),) = operator.answers
    assert word == "refused"
    assert text.startswith("geofence: real")
    assert "it was refused with MAV_MISSION_DENIED" in text
    assert "Geofence invalid, doesn't contain Home position" in text
    assert text.endswith("; the old fence applies")
    assert operator.aboard[0] == operator.aboard[1]
    assert event_texts(folder, "geofence") == []


@pytest.mark.parametrize("sets", [(), MIXED[:1]], ids=["px4", "ardupilot"])
def test_a_radio_that_loses_delays_it(fly_run: Fly, sets: tuple[str, ...]) -> None:
    operator = Operator((0.2, asks(TIGHTER)))
    bad = "links.twin={latency_ms: 80, jitter_ms: 40, loss: 0.05}"
    gap = "vehicles.twin.telemetry={max_gap_s: 0.5}"  # it may lose three positions in a row
    result, _ = flown_alone(fly_run, operator, bad, gap, *sets)
    assert (result.verdict, result.reason) == ("PASS", "")
    ((at_s, word, _),) = operator.answers
    assert word == "ok"
    assert at_s > 1.0
    assert operator.aboard[-1] == {"twin": (3, 3.0)}


def test_a_short_outage_in_the_middle_is_waited_for(fly_run: Fly) -> None:
    operator = Operator((1.0, asks(TIGHTER)))
    operator.on_goal = lambda pair: go_dark(pair, 1.05, 0.9)
    gap = "vehicles.twin.telemetry={max_gap_s: 2}"
    result, _ = flown_alone(fly_run, operator, CAN_GO_DARK, gap)
    assert (result.verdict, result.reason) == ("PASS", "")
    ((at_s, word, _),) = operator.answers
    assert word == "ok"
    assert at_s > 1.9
    assert operator.aboard[-1] == {"twin": (3, 3.0)}


def test_an_outage_that_does_not_end_leaves_the_old_fence(fly_run: Fly) -> None:
    operator = Operator((1.0, asks(TIGHTER)))
    operator.on_goal = lambda pair: go_dark(pair, 1.05, 6.0)
    result, folder = flown_alone(fly_run, operator, CAN_GO_DARK)
    assert result.verdict in {"ERROR", "FAIL"}
    ((_, word, text),) = operator.answers
    assert (word, text) == ("refused", "geofence: all vehicles are landing; the old fence applies")
    assert event_texts(folder, "geofence") == []
    assert all_landed(folder)


def go_dark(pair: VehiclePair, after_s: float, for_s: float) -> None:
    asyncio.get_running_loop().call_later(after_s, pair.guard.send, StartOutage("twin", for_s))


def test_an_abort_in_the_middle_wins(fly_run: Fly) -> None:
    operator = Operator((1.0, asks(TIGHTER)), (1.05, OperatorCommand("abort", "bert")))
    result, folder = flown(fly_run, operator)
    assert (result.verdict, result.reason) == ("ABORTED", "aborted by bert")
    ((at_s, word, text),) = operator.answers
    assert (word, text) == ("refused", "geofence: all vehicles are landing; the old fence applies")
    assert at_s < 1.2
    assert event_texts(folder, "geofence") == []
    assert all_landed(folder)


def test_a_second_change_at_once_is_refused(fly_run: Fly) -> None:
    operator = Operator((1.0, asks(WIDER)), (1.0, asks(TIGHTER)), (3.0, asks(TIGHTER)))
    result, _ = flown_alone(fly_run, operator)
    assert (result.verdict, result.reason) == ("PASS", "")
    busy = "geofence: another change of the fence is in progress; try again when it is answered"
    assert [(word, text) for _, word, text in operator.answers] == [
        ("refused", busy),
        ("ok", "anna changed the fence of twin"),
        ("ok", "anna changed the fence of twin"),
    ]
    assert operator.aboard[-1] == {"twin": (3, 3.0)}


def test_a_held_vehicle_may_be_given_another_fence(fly_run: Fly) -> None:
    script = [
        (1.0, OperatorCommand("hold", "anna")),
        (3.0, asks(TIGHTER)),
        (6.0, OperatorCommand("resume", "anna")),
    ]
    operator = Operator(*script)
    result, folder = flown_alone(fly_run, operator)
    assert result.verdict == "INVALID"
    assert [word for _, word, _ in operator.answers] == ["ok"]
    assert operator.answers[0][0] < 5.0
    assert all_landed(folder)


def test_a_ceiling_below_the_way_home_is_refused_where_that_is_only_checked(fly_run: Fly) -> None:
    operator = Operator((0.5, asks(TIGHTER)))
    heights: list[float] = []
    operator.on_goal = lambda pair: heights.append(returns_at(pair))
    result, folder = flown_alone(fly_run, operator, "preflight.failsafe=check", *CHECKED)
    assert heights == [2.2]
    assert result.verdict == "PASS"
    ((_, word, text),) = operator.answers
    assert word == "refused"
    assert "twin returns (RTL) above the new ceiling; set RTL_RETURN_ALT in the vehicle" in text
    assert event_texts(folder, "geofence") == []
    assert operator.aboard[0] == operator.aboard[1]


def test_a_lower_ceiling_lowers_the_way_home(fly_run: Fly) -> None:
    heights: list[float] = []
    low = "box: {north_m: [-0.9, 4.7], east_m: [-1.8, 1.8], up_m: [-0.5, 1.7]}"
    operator = Operator((0.5, asks(low)))

    def look_later(pair: VehiclePair) -> None:
        for after_s in (0.0, 3.0):
            loop = asyncio.get_running_loop()
            loop.call_later(after_s, lambda: heights.append(returns_at(pair)))

    operator.on_goal = look_later
    result, _ = flown_alone(fly_run, operator)
    assert (result.verdict, result.reason) == ("PASS", "")
    assert heights == pytest.approx([0.75 * 2.3, 0.75 * 1.7])


CHECKED = ("vehicles.twin.params={NAV_DLL_ACT: 3, RTL_RETURN_ALT: 2.2}",)


def returns_at(pair: VehiclePair) -> float:
    vehicle = pair.vehicles["twin"]
    assert isinstance(vehicle, EmbeddedVehicle)
    return float(vehicle.autopilot.parameters["RTL_RETURN_ALT"])


def test_nothing_is_uploaded_where_the_campaign_says_so(fly_run: Fly) -> None:
    operator = Operator((0.5, asks(TIGHTER)))
    counted: list[int] = []

    def listen(pair: VehiclePair) -> None:
        splitter = FrameSplitter()
        write = pair.links["twin"].write

        def spy(data: bytes) -> None:
            counted.extend(frame.message_id for frame in splitter.feed(data))
            write(data)

        pair.links["twin"].write = spy  # type: ignore[method-assign]  # to see what is sent

    operator.on_goal = listen
    result, folder = flown_alone(fly_run, operator, "preflight.fence=null")
    assert result.verdict == "PASS"
    assert event_texts(folder, "geofence") == ["anna changed the fence of twin"]
    assert counted
    assert not {MISSION_COUNT, PARAM_SET} & set(counted)
