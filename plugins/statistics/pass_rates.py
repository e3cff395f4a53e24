"""Pass rates with their intervals, exact tests between modes, agreement with reality; pure.

INVALID, ERROR and ABORTED prove nothing: they are not in the denominator, and counted separately.
Runs with equal measurements are one observation flown several times: they have neither an interval
nor a test.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

from wil_campaign.orchestrator.run_results.exit_codes import are_runs_equal, measured_values_of_run
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.statistics.inference.exact_tests import (
    PassCounts,
    Table,
    fisher_exact,
    stratified_exact,
)
from wil_campaign.plugins.statistics.proportions import RateInterval, clopper_pearson

MODES = ("sim", "wil", "real")


@dataclass(frozen=True, slots=True)
class PassRate:
    """Pass rate of a case in a mode. unproven: flights that ended without a PASS or FAIL.

    deterministic: two or more flights, and all equal. interval: of the pass rate, Clopper-Pearson;
    None where nothing was flown or where the flights are equal.
    """

    case: str
    mode: str
    passed: int
    flown: int
    unproven: int
    deterministic: bool
    interval: RateInterval | None


@dataclass(frozen=True, slots=True)
class ModeTest:
    """An exact test whether two modes have the same pass rate. case: empty for all cases.

    p: two-sided; None where a mode has no flights or equal ones; `why` has the reason.
    """

    case: str
    one: str
    other: str
    p: float | None
    why: str = ""


@dataclass(frozen=True, slots=True)
class RealityAgreement:
    """How a mode's verdicts agree with those of reality, over the cases flown in both.

    cases_agree: cases in which both found a failure, or neither did. verdicts_agree: the
    probability that a flight of the mode and one of reality end alike, mean over the cases.
    """

    mode: str
    cases: int
    cases_agree: int
    verdicts_agree: float


@dataclass(frozen=True, slots=True)
class PassRates:
    """The pass rates of a campaign by case and mode, with tests and agreement of the modes."""

    rates: tuple[PassRate, ...]
    tests: tuple[ModeTest, ...]
    agreement: tuple[RealityAgreement, ...]


def pass_rates(runs: Iterable[RunResult], *, confidence: float = 0.95) -> PassRates:
    """Return the pass rates of runs; controls are left out."""
    groups: dict[tuple[str, str], list[RunResult]] = {}
    for run in runs:
        if run.control is None:
            groups.setdefault((run.case, run.mode), []).append(run)
    rates = {key: _pass_rate(*key, group, confidence) for key, group in groups.items()}
    cases = tuple(dict.fromkeys(case for case, _ in rates))
    modes = [mode for mode in MODES if any(mode == one for _, one in rates)]
    tests: list[ModeTest] = []
    for one, other in combinations(modes, 2):
        pairs = [
            (rates[case, one], rates[case, other])
            for case in cases
            if (case, one) in rates and (case, other) in rates
        ]
        tests += [_test(*pair) for pair in pairs]
        if len(pairs) > 1:
            tests.append(_pooled(one, other, pairs))
    agreement = [_agreement(mode, cases, rates) for mode in modes if mode != "real"]
    return PassRates(
        tuple(rates.values()), tuple(tests), tuple(one for one in agreement if one is not None)
    )


def distinct_runs(runs: Iterable[RunResult]) -> list[RunResult]:
    """Return the runs without repeats: those of a seed that measured the same count once."""
    found: dict[tuple[object, ...], RunResult] = {}
    for run in runs:
        found.setdefault((run.seed, measured_values_of_run(run)), run)
    return list(found.values())


def is_proven(run: RunResult) -> bool:
    """Return whether a run proves anything: a PASS or a FAIL."""
    return run.verdict in {"PASS", "FAIL"}


def _pass_rate(case: str, mode: str, runs: Sequence[RunResult], confidence: float) -> PassRate:
    proven = [run for run in runs if is_proven(run)]
    passed, equal = sum(run.verdict == "PASS" for run in proven), are_runs_equal(proven)
    return PassRate(
        case=case,
        mode=mode,
        passed=passed,
        flown=len(proven),
        unproven=len(runs) - len(proven),
        deterministic=equal,
        interval=None if equal else clopper_pearson(passed, len(proven), confidence=confidence),
    )


def _test(one: PassRate, other: PassRate) -> ModeTest:
    why = _untestable(one) or _untestable(other)
    p = None if why else fisher_exact(*_counts(one, other))
    return ModeTest(one.case, one.mode, other.mode, p, why)


def _pooled(one: str, other: str, pairs: Sequence[tuple[PassRate, PassRate]]) -> ModeTest:
    """Return the test over all cases, each a stratum of its own."""
    fit = [pair for pair in pairs if not any(_untestable(rate) for rate in pair)]
    if not fit:
        return ModeTest("", one, other, None, "no case can be tested")
    why = "" if len(fit) == len(pairs) else f"{len(fit)} of {len(pairs)} cases can be tested"
    return ModeTest("", one, other, stratified_exact(_counts(*pair) for pair in fit), why)


def _counts(one: PassRate, other: PassRate) -> Table:
    return PassCounts(one.passed, one.flown), PassCounts(other.passed, other.flown)


def _untestable(rate: PassRate) -> str:
    """Return why flights cannot be tested; empty where they can."""
    if not rate.flown:
        return f"no flight of {rate.mode} ended with PASS or FAIL"
    return f"the flights of {rate.mode} are equal" if rate.deterministic else ""


def _agreement(
    mode: str, cases: Iterable[str], rates: dict[tuple[str, str], PassRate]
) -> RealityAgreement | None:
    agree, shares = 0, list[float]()
    for case in cases:
        one, real = rates.get((case, mode)), rates.get((case, "real"))
        if one is None or real is None or not one.flown or not real.flown:
            continue
        agree += (one.passed < one.flown) == (real.passed < real.flown)
        first, second = one.passed / one.flown, real.passed / real.flown
        shares.append(first * second + (1.0 - first) * (1.0 - second))
    if not shares:
        return None
    return RealityAgreement(mode, len(shares), agree, sum(shares) / len(shares))
