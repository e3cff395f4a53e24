"""Mutants of the product that the flights that must fail have to find: each check switched off.

`python -m tests.faults.mutants [NAME ...]` flies each mutant in a process of its own, with the
faults of the first seeds that could show it, until a flight passes that must not; ends with 1
when a mutant was not found.
"""

import multiprocessing
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path
from typing import Any

from tests.faults.alterations import Alteration, Kind
from tests.faults.missions import Cause
from tests.faults.signals import SignalFault, draw, inject
from wil_campaign.orchestrator.run.judging import run_oracles
from wil_campaign.safety.evaluation import judge
from wil_campaign.safety.evidence import agreement, coverage, evidence, poses
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.safety.oracles import contact, reached
from wil_campaign.safety.oracles.passages import GatePassage

_TRIED = 12
"""Flights for each mutant at most."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """A check that is switched off. could: which faults could show it.

    sharpen: makes a fault that shows it of one, where such faults are drawn too rarely.
    """

    switch_off: Callable[[], None]
    could: Callable[[SignalFault], bool]
    sharpen: Callable[[SignalFault], SignalFault] = lambda fault: fault


def _set(owner: Any, name: str, value: Any) -> Callable[[], None]:
    return lambda: setattr(owner, name, value)


def _gaps() -> None:
    coverage.SignalCoverage._close_gap = lambda *_: None  # type: ignore[method-assign]
    coverage.SignalCoverage.tick = lambda *_: None  # type: ignore[method-assign]


def _not_required() -> None:
    runs: Any = run_oracles
    plain = runs.signal_terms
    runs.signal_terms = lambda *args: (replace(one, required=False) for one in plain(*args))


def _any_order() -> None:
    plain = reached.ReachedOracle._pass

    def take(self: Any, name: str, passage: GatePassage) -> Any:
        done = [one.gate for one in self._through]
        if name not in done:
            gates = dict(self._route)
            others = [gate for gate in gates if gate not in {*done, name}]
            self._route = tuple((one, gates[one]) for one in (*done, name, *others))
        return plain(self, name, passage)

    reached.ReachedOracle._pass = take  # type: ignore[method-assign]


def _beside_counts() -> None:
    plain = reached.ReachedOracle._pass

    def take(self: Any, name: str, passage: GatePassage) -> Any:
        return plain(self, name, replace(passage, reach_m=0.0, offset_m=0.0))

    reached.ReachedOracle._pass = take  # type: ignore[method-assign]


def _blind_while_landing() -> None:
    plain = contact.ClearanceOracle.on_pose

    def take(self: Any, sample: PoseSample) -> Any:
        return () if self.stages.at("land") is not None else plain(self, sample)

    contact.ClearanceOracle.on_pose = take  # type: ignore[method-assign]


def _without(signal: str) -> Callable[[], None]:
    """Leave a signal out of the evidence.

    To skip `Evidence.pose` alone is no such mutant: coverage then counts no sample of a pose, and
    every flight is INVALID.
    """

    def switch_off() -> None:
        runs: Any = run_oracles
        plain = runs.signal_terms
        runs.signal_terms = lambda *args: (one for one in plain(*args) if one.signal != signal)

    return switch_off


def _early(fault: SignalFault, *kinds: str) -> bool:
    """Return whether a fault of the judged source hides what the flight does after takeoff."""
    source = "mocap" if fault.judged_by == "mocap" else "position"
    begins = fault.stage == "at_height" or (fault.stage == "goal" and fault.after_s < 1.0)
    hidden = fault.cause in {"wall", "table", "area", "fence"}
    judged = fault.vehicle == fault.subject and fault.signal == source
    return fault.mode == "sim" and judged and begins and hidden and fault.kind in kinds


def _hiding(cause: Cause, signal: str, *kinds: Kind) -> Mutant:
    """Return a mutant without a signal's evidence, whose fault hides the cause from the start."""

    def sharpen(fault: SignalFault) -> SignalFault:
        alteration = replace(fault.alteration, kind=kinds[fault.seed % len(kinds)])
        return replace(
            fault, cause=cause, signal=signal, judged_by="mavlink", vehicle="twin",
            stage="at_height", after_s=0.0, alteration=alteration,
        )  # fmt: skip

    return Mutant(_without(signal), lambda fault: fault.mode == "sim", sharpen)


def _beside_the_bar(fault: SignalFault) -> SignalFault:
    """Return a bias of the estimate that leads it through a gate whose bar the vehicle meets.

    It is too small for the estimate's own velocity to show it.
    """
    return replace(
        fault,
        cause="bar",
        vehicle="twin",
        judged_by="mavlink",
        signal="position",
        lone=False,
        stage="at_height",
        alteration=Alteration("bias", (0.0, -0.42, 0.0), 0.0),
    )


def _for(*causes: str) -> Callable[[SignalFault], bool]:
    harmless = {"text", "acknowledgement", "battery"}
    return lambda fault: fault.mode == "sim" and fault.cause in causes and fault.signal in harmless


MUTANTS: dict[str, Mutant] = {
    "gaps are no fault": Mutant(_gaps, lambda fault: _early(fault, "stop")),
    "a source may repeat itself": Mutant(
        _set(poses.PoseCoverage, "in_the_air", property(lambda _: False)),
        lambda fault: _early(fault, "freeze") and fault.lone and fault.judged_by == "mavlink",
    ),
    "sources are not compared": Mutant(
        _set(agreement.PositionAgreement, "_compare", lambda _: None),
        lambda fault: fault.mode == "sim",
        _beside_the_bar,
    ),
    "evidence decides nothing": Mutant(
        _set(judge.Judge, "_receive_evidence", lambda _: None),
        lambda fault: _early(fault, "stop", "freeze"),
    ),
    "no signal is required": Mutant(_not_required, lambda fault: _early(fault, "stop", "freeze")),
    "evidence takes no pose": Mutant(
        _without(evidence.POSE), lambda fault: _early(fault, "stop", "freeze")
    ),
    "a velocity is no evidence": _hiding("speed", evidence.VELOCITY, "freeze", "stop"),
    "a velocity in a formula is no evidence": _hiding("formula", evidence.VELOCITY, "stop"),
    "an attitude is no evidence": _hiding("tilt", evidence.ATTITUDE, "freeze"),
    "a battery may fall silent": _hiding("battery", "battery", "stop"),
    "an estimator may fall silent": _hiding("estimator", "estimator", "stop"),
    "contacts are not always judged": Mutant(
        _set(judge, "_judges_every_contact", lambda *_: True), _for("wall")
    ),
    "what is touched while landing is not judged": Mutant(_blind_while_landing, _for("table")),
    "gates count in any order": Mutant(_any_order, _for("wrong order")),
    "beside a gate is through it": Mutant(_beside_counts, _for("around")),
}


def is_found(name: str) -> str:
    """Return the seed and reason by which a mutant is found; "" when it is not."""
    mutant = MUTANTS[name]
    faults = (mutant.sharpen(fault) for fault in map(draw, count()) if mutant.could(fault))
    mutant.switch_off()
    with tempfile.TemporaryDirectory(prefix="wil-mutant-") as folder:
        for fault in islice(faults, _TRIED):
            outcome = inject(fault, Path(folder) / str(fault.seed))
            if outcome.wrong:
                return f"seed {fault.seed}"
    return ""


def main(arguments: list[str]) -> int:
    wanted = arguments or list(MUTANTS)
    found = 0
    for name in wanted:
        # What is switched off ends with its process.
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            by = pool.apply(is_found, (name,))
        found += bool(by)
        sys.stdout.write(f"{name}: {'found by ' + by if by else 'NOT FOUND'}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{found} of {len(wanted)} mutants found\n")
    return 0 if found == len(wanted) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
