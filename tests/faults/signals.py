"""Flights that must fail, each with a seeded fault of something that it is judged by.

`python -m tests.faults.signals FIRST COUNT FOLDER` prints one JSON object for each flight. None may
be a PASS, but where the only source of a vehicle's place says wrongly where it is.
"""

import asyncio
import json
import re
import shutil
import sys
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.faults.alterations import (
    MESSAGES,
    POSSIBLE,
    Alteration,
    reading_change,
    signal_change,
)
from tests.faults.images import altered_images
from tests.faults.missions import (
    CAUSES,
    AutopilotKind,
    Cause,
    JudgedBy,
    Mode,
    mission_of,
    write_mission,
)
from tests.faults.motion_capture import captured
from tests.faults.relay import Change, lost_position, relay
from tests.faults.truth_changes import truth_change
from tests.orchestrator.conftest import vehicles_on
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.run.flight.run import fly_one_run
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.model.samples import ReferenceSample

_STAGES: tuple[Stage, ...] = ("takeoff", "at_height", "goal", "land")
_SIGNALS = (
    *("position",) * 6,
    *("mocap",) * 4,
    *("attitude", "heartbeat", "landed_state", "battery", "estimator", "text"),
    *("acknowledgement", "timesync", "link", "process", "ground speed", "picture", "picture"),
)
"""What is faulty, as often as it stands here."""
JUDGED_BESIDE: Mapping[Cause, str] = {
    "speed": "velocity",
    "tilt": "attitude",
    "battery": "battery",
    "estimator": "estimator",
    "formula": "velocity",
}
"""What an oracle of a cause judges beside the position; it is the faulty one in a third."""
_BY_THE_VEHICLE_ALONE: frozenset[tuple[Cause, str]] = frozenset(
    {("battery", "battery"), ("estimator", "estimator")}
)
"""Causes that nothing but a report of the vehicle says."""
LOST_AFTER_S = 2.0
"""How long after the goal was given the estimator loses its position in the mission of it."""
_BETTER: dict[JudgedBy, frozenset[str]] = {
    "mavlink": frozenset({"mocap", "truth"}),
    "mocap": frozenset({"truth"}),
    "simulator": frozenset({"mocap", "truth"}),
}
"""Which sources know better than the one that is judged."""


@dataclass(frozen=True, slots=True)
class SignalFault:
    """A fault of one signal of one vehicle, in a flight that must fail.

    lone: whether no better source than the judged one knows where the vehicle is. signal: a key
    of POSSIBLE.
    """

    seed: int
    cause: Cause
    mode: Mode
    autopilot: AutopilotKind
    judged_by: JudgedBy
    signal: str
    vehicle: str
    lone: bool
    stage: Stage
    after_s: float
    alteration: Alteration

    @property
    def kind(self) -> str:
        """Return what kind of fault it is."""
        return self.alteration.kind

    @property
    def subject(self) -> str:
        """Return the vehicle that is judged."""
        return "twin" if self.mode == "sim" else "real"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a flight came to, whether no second source could show it, and whether that is wrong."""

    fault: SignalFault
    verdict: str
    reason: str
    decided_by: str
    exempt: bool
    wrong: bool


def draw(seed: int) -> SignalFault:
    """Return the fault of a seed; every fourth flies the pair."""
    rng = np.random.default_rng([seed, 31])
    mode: Mode = "wil" if seed % 4 == 3 else "sim"
    signals = _SIGNALS if mode == "wil" else [one for one in _SIGNALS if one != "picture"]
    signal = signals[int(rng.integers(len(signals)))]
    cause = CAUSES[int(rng.integers(len(CAUSES)))]
    if cause in JUDGED_BESIDE and rng.random() < 1 / 3:
        signal = JUDGED_BESIDE[cause]
    kinds = POSSIBLE[signal]
    by_capture = signal == "mocap" or bool(rng.random() < (0.5 if mode == "wil" else 0.2))
    stage = _STAGES[int(rng.integers(len(_STAGES)))]
    offset_m = tuple(float(value) for value in rng.uniform(-1.5, 1.5, 3))
    sign = -1.0 if rng.integers(2) else 1.0
    beside = mode == "wil" and signal != "mocap" and bool(rng.random() < 0.25)
    return SignalFault(
        seed=seed,
        cause=cause,
        mode=mode,
        autopilot="ardupilot" if rng.random() < 0.2 else "px4",
        judged_by="mocap" if by_capture else "mavlink",
        signal=signal,
        vehicle="twin" if beside or mode == "sim" else "real",
        lone=bool(rng.integers(2)),
        stage=stage,
        after_s=float(rng.uniform(0.0, 5.0 if stage == "goal" else 1.0)),
        alteration=Alteration(
            kind=kinds[int(rng.integers(len(kinds)))],
            offset_m=(offset_m[0], offset_m[1], offset_m[2]),
            step_s=sign * float(rng.uniform(0.1, 2.0)),
        ),
    )


def shown_by_none(fault: SignalFault) -> bool:
    """Return whether no second source could show a fault: docs/decisions/0049 lists these.

    The place of a vehicle by its estimate alone, or how far it leans: nothing else says it. A
    charge that is said again and again, and an estimator that goes on to report that it is sound:
    these look like a battery that is not used, and a sound estimator.
    """
    if fault.vehicle != fault.subject:
        return False
    if (fault.cause, fault.signal) in _BY_THE_VEHICLE_ALONE:
        return fault.kind in {"freeze", "duplicate", "bias", "jump"}
    leans = fault.cause == "tilt" and fault.signal == "attitude"
    alone = fault.lone and fault.judged_by == "mavlink"
    return alone and (fault.signal == "position" or leans) and fault.kind in {"bias", "jump"}


def inject(fault: SignalFault, folder: Path) -> Outcome:
    """Fly a flight that must fail with a fault in it."""
    strike = Strike(fault)
    with strike.around():
        result = fly_mission(fault, folder, strike.disturb)
    exempt = shown_by_none(fault)
    wrong = result.verdict == "PASS" and not exempt
    decided_by = result.decided_by or ""
    return Outcome(fault, result.verdict, result.reason, decided_by, exempt, wrong)


def fly_mission(
    fault: SignalFault,
    folder: Path,
    disturb: Callable[[VehiclePair, RunState], None] | None,
    prepare: Callable[[Path], None] = lambda _: None,
) -> RunResult:
    """Fly the flight of a fault, disturbed or not. prepare: changes the files of its folder."""

    def begin(pair: VehiclePair, run_state: RunState) -> None:
        # What the vehicle itself says comes first, and then what is done to it.
        if disturb is not None:
            disturb(pair, run_state)
        if fault.cause == "estimator":
            ids, change = MESSAGES["estimator"], lost_position()
            lost = relay(fault.subject, change, stage="goal", after_s=LOST_AFTER_S, message_ids=ids)
            lost(pair, run_state)

    folder.mkdir(parents=True)
    run_folder = folder / "run"
    run_folder.mkdir()
    path = mission_file(fault, folder)
    prepare(folder)
    plan = load_campaign(path, ExpansionOptions()).runs[0]
    order = RunOrder(plan=plan, folder=run_folder, clock="virtual")
    with vehicles_on():
        return fly_one_run(RunSetup.of(order), lambda _: None, _Nobody(), disturb=begin)


def fails_for_its_cause(fault: SignalFault, result: RunResult) -> bool:
    """Return whether a flight that nothing disturbed fails for the cause that is known, or passes.

    An estimate that reports its own loss proves nothing where it is what is judged.
    """
    if fault.cause == "none":
        return result.verdict == "PASS"
    if (fault.cause, fault.judged_by) == ("estimator", "mavlink"):
        return result.verdict == "INVALID" and "the estimator has lost" in result.reason
    named = re.search(mission_of(fault.cause, fault.mode).expected, result.reason)
    return result.verdict == "FAIL" and named is not None


class _Nobody:
    def poll(self) -> OperatorCommand | None:
        return None


def mission_file(fault: SignalFault, folder: Path) -> Path:
    """Write the files of a fault's flight into a folder; return its campaign."""
    return write_mission(
        folder,
        fault.cause,
        mode=fault.mode,
        autopilot=fault.autopilot,
        judged_by=fault.judged_by,
        keys={"seed": 1 + fault.seed % 1000},
    )


@dataclass(slots=True)
class Strike:
    """One fault in one run."""

    fault: SignalFault
    run_state: RunState | None = field(default=None)

    def around(self) -> AbstractContextManager[None]:
        """Return what has to hold while the flight is built and flown."""
        fault = self.fault
        if fault.signal != "picture":
            return nullcontext()
        return altered_images(fault.vehicle, fault.alteration, self.is_active)

    def is_active(self) -> bool:
        """Return whether the fault has begun."""
        fault, run_state = self.fault, self.run_state
        since_s = None if run_state is None else run_state.entered_s.get(fault.stage)
        now_s = asyncio.get_running_loop().time()
        return since_s is not None and now_s >= since_s + fault.after_s

    def disturb(self, pair: VehiclePair, run_state: RunState) -> None:
        """Begin it when its stage comes."""
        fault, self.run_state = self.fault, run_state
        silence_better(fault, pair, run_state)
        if fault.signal == "mocap":
            alter = reading_change(fault.alteration)
            captured(fault.vehicle, alter, stage=fault.stage, after_s=fault.after_s)(
                pair, run_state
            )
        elif fault.signal in MESSAGES:
            change, ids = _change(fault), MESSAGES[fault.signal]
            relay(
                fault.vehicle,
                change,
                stage=fault.stage,
                after_s=fault.after_s,
                message_ids=ids or None,
            )(pair, run_state)
        elif fault.signal == "process":
            run_state.on_stage(lambda stage, _: self._entered(stage, pair))

    def _entered(self, stage: Stage, pair: VehiclePair) -> None:
        if stage == self.fault.stage:
            loop = asyncio.get_running_loop()
            loop.call_later(self.fault.after_s, self._stop_vehicle, pair.vehicles)

    def _stop_vehicle(self, vehicles: Any) -> None:
        """Have a vehicle's process end, or stand for a while."""
        vehicle: Any = vehicles[self.fault.vehicle]
        vehicle.kill()
        if self.fault.kind == "freeze":
            step_s = abs(self.fault.alteration.step_s)
            asyncio.get_running_loop().call_later(step_s, _go_on, vehicle)


def _change(fault: SignalFault) -> Change:
    of_truth = fault.signal in {"ground truth", "places"}
    return (truth_change if of_truth else signal_change)(fault.signal, fault.alteration)


def _go_on(vehicle: Any) -> None:
    vehicle._alive = True
    vehicle._timer = vehicle._loop.call_soon(vehicle._tick)


def silence_better(fault: SignalFault, pair: VehiclePair, run_state: RunState) -> None:
    """Keep from the judge what knows better than the judged source, where a fault says so."""
    if fault.lone:
        # The judge listens by then.
        run_state.on_stage(lambda stage, _: _silence(pair, fault, stage))


def _silence(pair: VehiclePair, fault: SignalFault, stage: Stage) -> None:
    """Keep from the judge what knows better than the judged source, from takeoff on."""
    if stage != "takeoff":
        return
    unknown = _BETTER[fault.judged_by]
    for context in pair.contexts:
        if context.name != fault.subject:
            continue
        listeners: Any = context._reference_listeners
        listeners[:] = [_without(unknown, listener) for listener in listeners]


def _without(
    unknown: frozenset[str], listener: Callable[[ReferenceSample], None]
) -> Callable[[ReferenceSample], None]:
    def take(sample: ReferenceSample) -> None:
        if sample.source not in unknown:
            listener(sample)

    return take


def fly_seeds(
    drawn: Callable[[int], SignalFault],
    arguments: list[str],
    injected: Callable[[SignalFault, Path], Outcome] = inject,
) -> None:
    """Fly the seeds that the command line names, and print what came of them."""
    first, count, folder = int(arguments[0]), int(arguments[1]), Path(arguments[2])
    for seed in range(first, first + count):
        outcome = injected(drawn(seed), folder / str(seed))
        if not outcome.wrong:
            shutil.rmtree(folder / str(seed))
        sys.stdout.write(json.dumps(asdict(outcome)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    fly_seeds(draw, sys.argv[1:])
