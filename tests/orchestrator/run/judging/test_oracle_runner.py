"""What a vehicle reports is judged when it comes, not when the oracles are ticked next."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.orchestrator.wall import write_wall
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.run.judging.oracle_runner import OracleRunner
from wil_campaign.orchestrator.run.judging.run_oracles import build_judge
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.safety.model.verdict import decide_verdict
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.vehicles.driver.vehicle_state import VehicleEvent, VehicleState


class Vehicle:
    """A twin that reports what it is told to."""

    name = "twin"
    may_drop_out = False
    permits_dead_reckoning = False

    def __init__(self) -> None:
        self.state = VehicleState(
            armed=True, mode=FlightMode.GUIDED, mode_name="GUIDED", last_received_s=0.0
        )
        self.reported_s: dict[str, float] = {}
        self._event: Callable[[VehicleEvent], None] = lambda _: None

    @property
    def driver(self) -> "Vehicle":
        return self

    def on_event(self, take: Callable[[VehicleEvent], None]) -> None:
        self._event = take

    def ignore(self, *_: object) -> None: ...

    on_pose = on_reference = on_contact = on_failure = on_heading = ignore

    def take_arrivals(self) -> tuple[float, ...]:
        return ()

    def reports(self, t_s: float, mode: FlightMode) -> None:
        self.state = self.state._replace(mode=mode, mode_name=mode.name, last_received_s=t_s)
        self._event(VehicleEvent(t_s, "mode", mode.name, mode=mode))


def flying_vehicle(runner: OracleRunner, run_state: RunState) -> Any:
    """Return a vehicle of the run that flies its goal."""
    vehicle: Any = Vehicle()
    runner.attach(vehicle)
    runner.last_state(0.5)
    stages: tuple[Stage, ...] = ("takeoff", "at_height", "goal")
    for stage in stages:
        run_state.enter(stage)
    return vehicle


def test_a_mode_that_was_there_between_two_ticks_only_is_judged(tmp_path: Path) -> None:
    """A radio that stalled delivers several heartbeats at once; the last is none of the others."""
    plan = load_campaign(write_wall(tmp_path), ExpansionOptions(sets=("oracles.modes={}",))).runs[0]
    judge = build_judge(RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="virtual")), {})
    run_state = RunState(time=lambda: 1.0)
    runner = OracleRunner(
        judge=judge, run_state=run_state, kinds={}, flag_watchers=(), log_sample=lambda _: None
    )
    vehicle = flying_vehicle(runner, run_state)
    for mode in (FlightMode.HOLD, FlightMode.GUIDED):
        vehicle.reports(2.0, mode)
    runner.last_state(2.05)
    assert [(flag.oracle, flag.t_s) for flag in judge.flags] == [("modes", 2.0)]
    assert [one.kind for one in run_state.decisive] == ["FAIL"]


@pytest.mark.parametrize("is_oracle", [False, True])
def test_one_that_raises_hides_no_failure_of_the_same_sample(
    tmp_path: Path, *, is_oracle: bool
) -> None:
    """Be it a live feed that is told of the flag, or another oracle."""
    sets = ("oracles.modes={}", "oracles.link={max_gap_s: 1}")
    plan = load_campaign(write_wall(tmp_path), ExpansionOptions(sets=sets)).runs[0]
    judge = build_judge(RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="virtual")), {})
    run_state = RunState(time=lambda: 2.0)
    heard: list[str] = []

    def fail(*_: object) -> None:
        raise RuntimeError("a bug")

    async def fly() -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, what: run_state.fault(what["exception"], "in flight"))
        runner = OracleRunner(
            judge=judge,
            run_state=run_state,
            kinds={},
            flag_watchers=(*(() if is_oracle else (fail,)), lambda flag: heard.append(flag.oracle)),
            log_sample=lambda _: None,
        )
        vehicle = flying_vehicle(runner, run_state)
        if is_oracle:
            handlers = vars(judge)["_states"]["twin"]
            handlers.append(SimpleNamespace(__self__=judge.oracles[0]))
        with run_state.recording_faults("judging"):
            vehicle.reports(2.0, FlightMode.HOLD)
        await asyncio.sleep(0)

    run_virtual(fly())
    assert heard == ["modes"]
    assert [one.kind for one in run_state.decisive] == ["FAIL", "ERROR"]
    assert decide_verdict(run_state.decisive, (), end_s=9.0).verdict == "FAIL"


def test_the_least_clearance_is_of_the_oracles_that_measure_one() -> None:
    def oracle(name: str, actual: float | None) -> Any:
        return SimpleNamespace(name=name, result=lambda _: SimpleNamespace(actual=actual))

    oracles = (oracle("near", 0.7), oracle("touch", None), oracle("wide", 0.9), oracle("fast", 0.1))
    kinds = {"near": "clearance", "touch": "collision", "wide": "collision", "fast": "speed"}
    judge: Any = SimpleNamespace(oracles=oracles)
    run_state = RunState(time=lambda: 1.0)
    runner = OracleRunner(
        judge=judge, run_state=run_state, kinds=kinds, flag_watchers=(), log_sample=lambda _: None
    )
    assert runner.clearance_m(1.0) == 0.7
