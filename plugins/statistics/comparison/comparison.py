"""Regression test of cases: worse beyond chance, and by more than a given size; pure."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean
from typing import Literal

from wil_campaign.orchestrator.run_results.attempts import ended_attempts
from wil_campaign.orchestrator.run_results.exit_codes import are_runs_equal
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.statistics.comparison.errors import ComparisonError
from wil_campaign.plugins.statistics.inference.exact_tests import PassCounts, fisher_exact
from wil_campaign.plugins.statistics.inference.multiple_tests import holm_corrected
from wil_campaign.plugins.statistics.inference.permutation_test import permutation_p
from wil_campaign.plugins.statistics.pass_rates import distinct_runs, is_proven
from wil_campaign.safety.oracles.contact import exceeded_margin_m

Outcome = Literal["worse", "not worse", "undecided"]
_DIGITS = 12
"""Of a level: 1 - 0.9 is a little below 0.1."""
Cells = Mapping[tuple[str, str], Sequence[RunResult]]


@dataclass(frozen=True, slots=True)
class LossLimits:
    """Losses that count as worse. pass_rate: from 0 to 1; margin: in the oracle's unit.

    confidence: over all tests of a comparison together.
    """

    pass_rate: float = 0.1
    margin: float | None = None
    confidence: float = 0.95

    @property
    def level(self) -> float:
        """Return the largest p that is beyond chance."""
        return round(1.0 - self.confidence, _DIGITS)


@dataclass(frozen=True, slots=True)
class FigureChange:
    """One figure of a case and mode, before and after. what: "pass rate", or "margin of ORACLE".

    before, after: pass rates, or mean margins in `unit`; is_beyond: whether the mean of each side
    is known to be larger alone, as nothing came near in some flight. flights: their numbers, with a
    repeated flight once. loss: positive is worse. p: one-sided, corrected for the number of tests;
    0 where equal runs of both sides differ, which chance cannot explain; None where untestable.
    why: no loss could be decided; empty where one could. equal: whether the runs of each side are
    equal, so that its rate has no interval.
    """

    case: str
    mode: str
    what: str
    unit: str
    before: float
    after: float
    flights: tuple[int, int]
    loss: float
    p: float | None
    outcome: Outcome
    why: str = ""
    is_beyond: tuple[bool, bool] = (False, False)
    equal: tuple[bool, bool] = (False, False)


@dataclass(frozen=True, slots=True)
class FlightComparison:
    """The changes between two sets of flights, before and after.

    only_before, only_after: cells as "case/mode" that the other does not have. unproven: cells
    without a PASS or FAIL on one side. fewer_proven: cells with a larger share of INVALID, ERROR or
    ABORTED flights than before, which rates and margins leave out; as texts. flown_again: cells
    whose runs needed more attempts than before (retries); as texts. flips: runs whose
    verdict changed under the same seed. equal_seeds: how many runs had one. removed_oracles:
    oracles that judged a shared cell before, and are gone or only reported now; as texts.
    """

    changes: tuple[FigureChange, ...]
    only_before: tuple[str, ...] = ()
    only_after: tuple[str, ...] = ()
    unproven: tuple[str, ...] = ()
    flips: tuple[str, ...] = ()
    fewer_proven: tuple[str, ...] = ()
    flown_again: tuple[str, ...] = ()
    removed_oracles: tuple[str, ...] = ()
    equal_seeds: int = 0

    @property
    def is_less(self) -> bool:
        """Return whether less is judged now than before."""
        return bool(self.only_before or self.removed_oracles)

    @property
    def worse(self) -> tuple[FigureChange, ...]:
        """Return what became worse."""
        return tuple(change for change in self.changes if change.outcome == "worse")

    @property
    def untestable(self) -> tuple[FigureChange, ...]:
        """Return what lost more than its limit, where no loss could be told from chance."""
        return tuple(
            change for change in self.changes if change.outcome == "undecided" and change.why
        )


def runs_by_cell(runs: Iterable[RunResult]) -> dict[tuple[str, str], list[RunResult]]:
    """Return the runs by case and mode, controls left out."""
    found: dict[tuple[str, str], list[RunResult]] = {}
    for run in runs:
        if run.control is None:
            found.setdefault((run.case, run.mode), []).append(run)
    return found


def compare_flown_sets(before: Cells, after: Cells, limits: LossLimits) -> FlightComparison:
    """Return how the flights after differ from those before. Raises ComparisonError."""
    shared = [cell for cell in before if cell in after]
    if not shared:
        had, has = (
            ", ".join("/".join(one) for one in each) or "nothing" for each in (before, after)
        )
        raise ComparisonError(f"the campaigns have no case and mode in common: {had}; and {has}")
    changes: list[FigureChange] = []
    unproven: list[str] = []
    fewer_proven: list[str] = []
    for cell in shared:
        old, new = ([run for run in each[cell] if is_proven(run)] for each in (before, after))
        if old and new:
            changes += _cell_changes(cell, old, new, limits)
            fewer_proven += _fewer_proven(cell, before[cell], after[cell])
        else:
            unproven.append("/".join(cell))
    return FlightComparison(
        changes=tuple(_corrected(changes, limits)),
        only_before=tuple("/".join(cell) for cell in before if cell not in after),
        only_after=tuple("/".join(cell) for cell in after if cell not in before),
        unproven=tuple(unproven),
        flips=tuple(text for cell in shared for text in _flips(before[cell], after[cell])),
        equal_seeds=sum(len(_paired(before[cell], after[cell])) for cell in shared),
        fewer_proven=tuple(fewer_proven),
        flown_again=tuple(
            text for cell in shared for text in _flown_again(cell, before[cell], after[cell])
        ),
        removed_oracles=tuple(
            text for cell in shared for text in _removed_oracles(cell, before[cell], after[cell])
        ),
    )


def _removed_oracles(
    cell: tuple[str, str], old: Sequence[RunResult], new: Sequence[RunResult]
) -> list[str]:
    """Return the oracles of a cell that no longer judge it, or are only reported now; as texts."""
    had, has = _oracles(old), _oracles(new)
    where = "/".join(cell)
    found = [f"{where}: {name} of {vehicle}" for name, vehicle in had if (name, vehicle) not in has]
    return found + [
        f"{where}: {name} of {vehicle} is only reported now"
        for (name, vehicle), is_required in had.items()
        if is_required and has.get((name, vehicle)) is False
    ]


def _oracles(runs: Sequence[RunResult]) -> dict[tuple[str, str], bool]:
    """Return the oracles of runs by name and vehicle, and whether each was required.

    A run without a flight has none.
    """
    found: dict[tuple[str, str], bool] = {}
    for oracle_result in (oracle for run in runs for oracle in run.oracles):
        key = (oracle_result.name, oracle_result.vehicle)
        found[key] = found.get(key, False) or oracle_result.required
    return found


def _fewer_proven(
    cell: tuple[str, str], old: Sequence[RunResult], new: Sequence[RunResult]
) -> list[str]:
    """Return a text if a larger share of a cell's flights is unproven than before; else nothing."""
    was, now = (sum(not is_proven(run) for run in runs) for runs in (old, new))
    if now * len(old) <= was * len(new):
        return []
    return [f"{'/'.join(cell)}: {now} of {len(new)} flights, {was} of {len(old)} before"]


def _flown_again(
    cell: tuple[str, str], old: Sequence[RunResult], new: Sequence[RunResult]
) -> list[str]:
    """Return a text if a cell's runs needed more attempts than before; else nothing."""
    was, now = (sum(len(ended_attempts(run.attempts)) for run in runs) for runs in (old, new))
    if now * len(old) <= was * len(new):
        return []
    return [f"{'/'.join(cell)}: {now} beside {len(new)} flights, {was} beside {len(old)} before"]


def _cell_changes(
    cell: tuple[str, str], old: Sequence[RunResult], new: Sequence[RunResult], limits: LossLimits
) -> list[FigureChange]:
    """Return the changes of a case and mode, with uncorrected p."""
    once = [distinct_runs(runs) for runs in (old, new)]
    counts = [PassCounts(sum(run.verdict == "PASS" for run in runs), len(runs)) for runs in once]
    was, now = (count.passed / count.flown for count in counts)
    flights = (len(once[0]), len(once[1]))
    p, why = _testable(old, new, was != now)
    if not why and p is None:
        p = fisher_exact(counts[1], counts[0], "less")
    what = "pass rate"
    change = FigureChange(*cell, what, "", was, now, flights, was - now, p, "not worse", why)
    found = [replace(change, equal=(are_runs_equal(old), are_runs_equal(new)))]
    if limits.margin is None:
        return found
    margins = [_margins(runs) for runs in once]
    for name, was_kept in margins[0].items():
        is_kept = margins[1].get(name)
        if is_kept is None or is_kept.unit != was_kept.unit:
            continue
        if was_kept.is_all_beyond and is_kept.is_all_beyond:
            continue
        values, other = was_kept.values, is_kept.values
        was, now = fmean(values), fmean(other)
        p, why = _testable(old, new, set(values) != set(other))
        if not why and p is None:
            p = permutation_p(other, values)
        found.append(
            FigureChange(
                *cell,
                what=f"margin of {name}",
                unit=was_kept.unit,
                before=was,
                after=now,
                flights=(len(values), len(other)),
                loss=was - now,
                p=p,
                outcome="not worse",
                why=why,
                is_beyond=(bool(was_kept.beyond), bool(is_kept.beyond)),
            )
        )
    return found


def _testable(
    old: Sequence[RunResult], new: Sequence[RunResult], differ: bool
) -> tuple[float | None, str]:
    """Return p, or why it is untestable, where the flights of a side are all equal."""
    equal = [are_runs_equal(runs) for runs in (old, new)]
    if all(equal):
        return (0.0 if differ else 1.0), ""
    if any(equal):
        return None, f"the flights {'before' if equal[0] else 'after'} are equal: one observation"
    return None, ""


@dataclass(frozen=True, slots=True)
class _Margins:
    """The margins of an oracle, in `unit`: known ones, and what others exceed (beyond)."""

    unit: str
    known: list[float] = field(default_factory=list)
    beyond: list[float] = field(default_factory=list)

    @property
    def values(self) -> list[float]:
        """Return all margins; one that exceeds a value as that value."""
        return self.known + self.beyond

    @property
    def is_all_beyond(self) -> bool:
        """Return whether nothing came near in any flight."""
        return not self.known


def _margins(runs: Sequence[RunResult]) -> dict[str, _Margins]:
    """Return the margins of each required oracle of the judged vehicle."""
    found: dict[str, _Margins] = {}
    for run in runs:
        for oracle in run.oracles:
            if not oracle.required or oracle.vehicle != run.subject:
                continue
            if oracle.margin is not None:
                found.setdefault(oracle.name, _Margins(oracle.unit)).known.append(oracle.margin)
            elif (beyond := exceeded_margin_m(oracle)) is not None:
                found.setdefault(oracle.name, _Margins(oracle.unit)).beyond.append(beyond)
    return found


def _corrected(changes: Sequence[FigureChange], limits: LossLimits) -> list[FigureChange]:
    """Return the changes with p corrected for multiple tests, and their outcomes."""
    tested = [change.p for change in changes if change.p is not None]
    corrected = iter(holm_corrected(tested))
    found = []
    for given in changes:
        change, p = given, None if given.p is None else next(corrected)
        size = limits.pass_rate if change.what == "pass rate" else limits.margin or 0.0
        large = change.loss > 0.0 and change.loss >= size - 1e-9
        outcome: Outcome = "not worse"
        if large and p is None:
            outcome = "undecided"
        elif large and p is not None:
            outcome = "worse" if p <= limits.level else "undecided"
            if outcome == "undecided" and _least_p(change) * len(tested) > limits.level:
                change = replace(change, why="so few flights decide no loss")
        found.append(replace(change, p=p, outcome=outcome))
    return found


def _least_p(change: FigureChange) -> float:
    """Return the p of the largest loss: every flight before is better than every one after."""
    return 1.0 / math.comb(sum(change.flights), change.flights[0])


def _flips(old: Sequence[RunResult], new: Sequence[RunResult]) -> list[str]:
    """Return runs whose verdict differs from the one that their seed always had before."""
    return [
        f"{run.case}/{run.mode}/{run.rep}: {had} before, {run.verdict} now"
        for run, had in _paired(old, new)
        if run.verdict != had
    ]


def _paired(old: Sequence[RunResult], new: Sequence[RunResult]) -> list[tuple[RunResult, str]]:
    """Return the new runs whose seed was flown before, with the verdict that it always had."""
    by_seed: dict[int, set[str]] = {}
    for run in old:
        if is_proven(run):
            by_seed.setdefault(run.seed, set()).add(run.verdict)
    return [
        (run, next(iter(had)))
        for run in new
        if is_proven(run) and len(had := by_seed.get(run.seed, set())) == 1
    ]
