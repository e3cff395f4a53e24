"""Short flights into which exceptions are injected, and what must come of each."""

import json
import shutil
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

from tests.faults.exceptions.injection import InjectingLoop, Injection, Probe, calls_pass_by
from tests.faults.witness import Witness
from tests.orchestrator.conftest import vehicles_on
from tests.orchestrator.hover import STILL, WORLD
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.clocks import virtual_loop as clock
from wil_campaign.orchestrator.campaign.resuming.runs_without_result import lost_result
from wil_campaign.orchestrator.campaign.workers.local_workers import _lost_by_exception
from wil_campaign.orchestrator.run.flight.run import Disturb, fly_one_run
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.exit_codes import exit_code
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.faults import fault_log
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

_VEHICLE = (
    "{link: embedded, autopilot: px4, "
    "sensors: {lidar: {type: lidar, rate_hz: 2, beams: 8, range_max_m: 5}}}"
)
_CAMPAIGN = f"""\
schema: wil/campaign/1
campaign: hover
vehicles:
  real: {_VEHICLE}
  twin: {_VEHICLE}
world: world.yaml
recipe: recipe.yaml
autonomy: {{use: still.py:Still, with: {{ticks: 8}}}}
goal: {{altitude_m: 0.8}}
modes: [sim, wil]
geofence: {{box: {{north_m: [-3, 3], east_m: [-3, 3], up_m: [-0.5, 4]}}}}
oracles: {{landed: {{}}, collision: {{}}, vehicle_fault: {{}}}}
"""
_RECIPE = """\
schema: wil/recipe/1
sensors: {lidar: {type: lidar, rate_hz: 2}}
combine:
  - sensor: lidar
    transform: [{register: {pose: real, align: interpolate}}]
    merge: {aggregate: {by: min}}
    publish: [real, twin]
    max_skew_ms: 600
"""
NOT_CALLED = ("vehicles/embedded", "worlds", "campaigns")
"""Whose functions are not raised in: of a simulated vehicle whose physics raise nobody can ask to
land, and files are read before a run."""


class Nobody:
    """An operator who says nothing."""

    def poll(self) -> OperatorCommand | None:
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of a flight. result: also of a run that raised, as its worker
    gives it. up: who was not down at the end."""

    injection: Injection | None
    result: RunResult | None
    raised: str
    up: tuple[str, ...]
    log: tuple[dict[str, Any], ...]
    happened: bool
    events: tuple[str, ...] = ()

    @property
    def faults(self) -> list[str]:
        """Return what must not be after an exception of ours."""
        if self.injection is None or not self.happened:
            return []
        found = [f"{name} is not down" for name in self.up]
        if self.result is None:
            return [*found, "no result"]
        if self.result.verdict == "PASS":
            found.append("PASS")
        elif exit_code([self.result], []) == 0:
            found.append("exit 0")
        kind = "InjectedError" if self.injection.error == "exception" else "CancelledError"
        lines = [one for one in self.log if one["event"] == "error" and one.get("type") == kind]
        if not any(
            "injected at" in line["message"] and "Traceback" in line["trace"] for line in lines
        ):
            found.append("no type, message and traceback in log.jsonl")
        reasons = [self.result.reason, *(one.reason for one in self.result.also)]
        if not any(kind in reason for reason in reasons):
            found.append("not among the reasons")
        return found


class Flights:
    """Flies one mode again and again from files in `folder`."""

    def __init__(self, folder: Path, mode: str) -> None:
        self._folder = folder
        (folder / "world.yaml").write_text(WORLD)
        (folder / "recipe.yaml").write_text(_RECIPE)
        (folder / "still.py").write_text(STILL)
        path = folder / "hover.yaml"
        path.write_text(_CAMPAIGN)
        self._plan = load_campaign(path, ExpansionOptions(modes=(mode,))).runs[0]

    def find(self, *, calls: bool = False) -> tuple[Probe, Outcome]:
        """Fly undisturbed, and return what points there are."""
        probe = Probe()
        return probe, self._fly(probe, calls=calls)

    def inject(self, injection: Injection) -> Outcome:
        """Fly with an exception in it."""
        return self._fly(Probe(injection), calls=injection.point.kind == "call")

    def watch_stage(self, stage: str, injection: Injection) -> Outcome:
        """Fly with a watcher of stages that raises at one of them."""

        def watch(_: VehiclePair, run_state: RunState) -> None:
            def entered(name: str, _: float) -> None:
                if name == stage:
                    probe.raised = True
                    raise injection.make()

            run_state.on_stage(entered)

        probe = Probe(injection)
        return self._fly(probe, calls=False, disturb=watch)

    def _fly(self, probe: Probe, *, calls: bool, disturb: Disturb | None = None) -> Outcome:
        folder = Path(tempfile.mkdtemp(dir=self._folder))
        setup = RunSetup.of(RunOrder(plan=self._plan, folder=folder, clock="virtual"))
        seen: list[Witness] = []

        def watch(pair: VehiclePair, run_state: RunState) -> None:
            probe.stage = lambda: run_state.stage
            seen.append(Witness(pair.vehicles))
            if disturb is not None:
                disturb(pair, run_state)

        result, raised = None, ""
        with ExitStack() as stack:
            stack.enter_context(vehicles_on())
            stack.enter_context(
                mock.patch.object(clock, "VirtualLoop", partial(InjectingLoop, probe))
            )
            if calls:
                stack.enter_context(calls_pass_by(probe, but=NOT_CALLED))
            try:
                result = fly_one_run(setup, lambda _: None, Nobody(), disturb=watch)
            except BaseException as error:  # noqa: BLE001 - a worker takes whatever it was
                lost = _lost_by_exception(error)
                raised, result = lost.reason, lost_result(self._plan, lost, folder)
                fault_log(folder / "log.jsonl")(lost.fault)
        up = [
            name
            for witness in seen
            for name, vehicle in witness._vehicles.items()
            if vehicle.autopilot.flight.armed
        ]
        path = folder / "log.jsonl"
        lines = path.read_text().splitlines() if path.exists() else []
        shutil.rmtree(folder)
        return Outcome(
            injection=probe.injection,
            result=result,
            raised=raised,
            up=tuple(up),
            log=tuple(json.loads(line) for line in lines),
            happened=probe.raised,
        )


def print_count(where: str, *, injected: int, happened: int, points: int) -> None:
    """Print how many of the possible exceptions were raised; `pytest -rP` shows it."""
    line = f"{where}: {injected} of {points} injections made, {happened} of them raised"
    sys.stdout.write(f"{line}\n")


def injections_of(probe: Probe) -> list[Injection]:
    """Return what to inject: an exception, and at awaits a cancellation, at each point's first."""
    found = []
    for point in sorted(probe.counts):
        found.append(Injection(point, 1))
        if point.kind == "await":
            found.append(Injection(point, 1, "cancelled"))
    return found
