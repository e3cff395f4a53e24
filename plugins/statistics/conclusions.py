"""Conclusions from the statistics of a campaign, in sentences: shown, not shown, needed; pure.

The tables have the figures; these sentences state what follows from them, and what does not.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

from wil_campaign.plugins.statistics.gap.energy import EnergyFigure
from wil_campaign.plugins.statistics.gap.gap import ALL_CASES, GapFigure
from wil_campaign.plugins.statistics.inference.exact_tests import PassCounts, stratified_rounded
from wil_campaign.plugins.statistics.inference.multiple_tests import holm_corrected
from wil_campaign.plugins.statistics.inference.probability_text import p_text
from wil_campaign.plugins.statistics.pass_rates import MODES, ModeTest, PassRate
from wil_campaign.plugins.statistics.proportions import RateInterval
from wil_campaign.plugins.statistics.published import counts_in
from wil_campaign.plugins.statistics.study import Study

MODE_NAMES = {"sim": "simulation", "wil": "WIL", "real": "reality"}
"""Names of the modes in tables and sentences."""

Kind = Literal["shown", "not shown", "contradicted", "needed", "note"]

_LEVEL = 0.05
_MOST_TIMES = 40
"""Multiples of the flown flights: a difference that needs more gets no figure."""
_MEASURE_NAMES = {
    "dtw": "the paths (dtw)",
    "frechet": "the largest distance of the paths (frechet)",
    "rmse": "the positions at equal times (rmse)",
    "commands": "the autonomy's commands",
    "answers": "the vehicle's answers to them",
}

Figure = GapFigure | EnergyFigure
AnyFigure = TypeVar("AnyFigure", GapFigure, EnergyFigure)


@dataclass(frozen=True, slots=True)
class Conclusion:
    """One conclusion from the statistics. kind: shown, not shown, contradicted, ..."""

    kind: Kind
    text: str


def study_conclusions(study: Study) -> list[Conclusion]:
    """Return what the statistics show, what they do not show, and how many flights would.

    Empty for a campaign of a single mode: there is nothing to compare.
    """
    found = list(_of_pass_rates(study))
    means, energies = _widest(study.gap.figures), _widest(study.gap.energies)
    flown = max((study.gap.flights or {}).values(), default=0)
    found += _of_gap("By the mean distance between flights", means, flown)
    found += _of_gap("With the spread of each mode taken into account", energies, flown)
    found += _on_disagreement(means, energies)
    found += _of_published(study)
    return found


def _of_pass_rates(study: Study) -> Iterator[Conclusion]:
    """Yield whether the pass rates of the modes differ, and how many flights would show it."""
    modes = [mode for mode in MODES if any(rate.mode == mode for rate in study.rates.rates)]
    if len(modes) < 2:
        return
    counts = ", ".join(f"{MODE_NAMES[mode]} {_count_text(study, mode)}" for mode in modes)
    yield Conclusion("note", f"Passed flights: {counts}.")
    tests = _corrected(list(_widest_tests(study.rates.tests)))
    apart = [test for test in tests if test.p is not None and test.p < _LEVEL]
    alike = [test for test in tests if test.p is not None and test.p >= _LEVEL]
    untested = [test for test in tests if test.p is None]
    family = len(tests) - len(untested)
    if apart:
        yield Conclusion(
            "shown", f"The pass rates of the modes differ: {_pairs_text(apart, family)}."
        )
    if alike:
        others = " for the other pairs of modes" if apart else ""
        pairs = _pairs_text(alike, family)
        yield Conclusion(
            "not shown",
            f"No difference in pass rates is shown{others} ({pairs}: chance alone can "
            "explain the differences). Equal pass rates are not shown either.",
        )
        yield from _needed_for_passes(study, alike)
    if untested:
        text = "; ".join(f"{_pair_text(mode_test)}: {mode_test.why}" for mode_test in untested)
        yield Conclusion("not shown", f"These pass rates cannot be tested: {text}.")


def _count_text(study: Study, mode: str) -> str:
    rates = [rate for rate in study.rates.rates if rate.mode == mode]
    return f"{sum(rate.passed for rate in rates)} of {sum(rate.flown for rate in rates)}"


def _widest_tests(tests: Sequence[ModeTest]) -> Iterator[ModeTest]:
    """Yield the test over all cases for each pair of modes; for a single case, its own."""
    for pair in dict.fromkeys((test.one, test.other) for test in tests):
        own = [test for test in tests if (test.one, test.other) == pair]
        yield next((mode_test for mode_test in own if not mode_test.case), own[0])


def _corrected(tests: Sequence[ModeTest]) -> list[ModeTest]:
    """Return tests with p values corrected for their number: one that is shown by chance is rare.

    Each alone, some pair of three modes that pass alike differed in 4 to 10 % of campaigns of 40 to
    100 flights (3,000 simulated each); corrected in 4 % at most.
    """
    corrected = iter(holm_corrected([test.p for test in tests if test.p is not None]))
    return [test if test.p is None else replace(test, p=next(corrected)) for test in tests]


def _pair_text(test: ModeTest) -> str:
    return f"{MODE_NAMES[test.one]} and {MODE_NAMES[test.other]}"


def _pairs_text(tests: Iterable[ModeTest], family: int) -> str:
    """Return pairs of modes with their p. family: for how many tests that is corrected."""
    pairs = "; ".join(
        f"{_pair_text(test)}, p {p_text(test.p, _LEVEL)}" for test in tests if test.p is not None
    )
    return f"{pairs}, corrected for {family} pairs" if family > 1 else pairs


def _needed_for_passes(study: Study, tests: Sequence[ModeTest]) -> Iterator[Conclusion]:
    texts = []
    level = _LEVEL / sum(test.p is not None for test in _widest_tests(study.rates.tests))
    for test in tests:
        times = _times_for_difference(study.rates.rates, test, level)
        if times is not None:
            texts.append(f"{times} times the flights for {_pair_text(test)}")
    if texts:
        needed = ", ".join(texts)
        yield Conclusion(
            "needed", f"To show a difference, if the pass rates stay the same: {needed}."
        )


def _times_for_difference(rates: Sequence[PassRate], test: ModeTest, level: float) -> int | None:
    """Return the multiple of the flights that would show a difference; None for too many.

    level: below which the test's own p has to be.
    """
    by_place = {(rate.case, rate.mode): rate for rate in rates if not rate.deterministic}
    cases = [test.case] if test.case else list(dict.fromkeys(rate.case for rate in rates))
    pairs = [
        (by_place[case, test.one], by_place[case, test.other])
        for case in cases
        if (case, test.one) in by_place and (case, test.other) in by_place
    ]
    if sum(a.passed * b.flown - b.passed * a.flown for a, b in pairs) == 0:
        return None
    for times in range(2, _MOST_TIMES + 1):
        tables = [
            (
                PassCounts(a.passed * times, a.flown * times),
                PassCounts(b.passed * times, b.flown * times),
            )
            for a, b in pairs
        ]
        if stratified_rounded(tables) < level:
            return times
    return None


def _widest(figures: Sequence[AnyFigure]) -> list[AnyFigure]:
    """Return the figures over all cases; where there are none, those of the single case."""
    pooled = [figure for figure in figures if figure.case == ALL_CASES]
    if pooled:
        return [one for one in pooled if one.nearer_by is not None]
    cases = {figure.case for figure in figures}
    return [figure for figure in figures if len(cases) == 1 and figure.nearer_by is not None]


def _of_gap(title: str, figures: Sequence[Figure], flown: int) -> Iterator[Conclusion]:
    """Yield whether the figures show that WIL is nearer to reality than simulation is.

    flown: the number of flights of a case and mode.
    """
    where = f"{title}, {_case_text(figures)}"
    nearer, farther, undecided, unknown = _split_by_outcome(figures)
    claim = "WIL is nearer to reality than simulation"
    if nearer:
        alone = _alone_text(nearer, figures)
        yield Conclusion("shown", f"{where}: {claim}, by {_names(nearer)}{alone}.")
    if farther:
        text, alone = "WIL is farther from reality than simulation", _alone_text(farther, figures)
        yield Conclusion("contradicted", f"{where}: {text}, by {_names(farther)}{alone}.")
    if undecided:
        text = f"it is undecided whether {claim}, by {_names(undecided)}"
        yield Conclusion("not shown", f"{where}: {text} (the interval contains 0).")
        yield from _needed_for_gap(undecided, flown)
    if unknown:
        text = f"it is unknown whether {claim}, by {_names(unknown)}"
        yield Conclusion(
            "not shown", f"{where}: {text}: the flights have no spread, or are too few."
        )


def _alone_text(some: Sequence[Figure], figures: Sequence[Figure]) -> str:
    """Return that intervals hold alone, where some of the measures say what the others do not.

    One of five is beyond chance by chance more often than each.
    """
    if len(some) == len(figures):
        return ""
    return f" ({len(some)} of {len(figures)} measures; each interval holds alone)"


def _case_text(figures: Sequence[Figure]) -> str:
    case = figures[0].case if figures else ""
    return f"over {case}" if case == ALL_CASES else f"in {case}"


def _split_by_outcome(
    figures: Sequence[Figure],
) -> tuple[list[Figure], list[Figure], list[Figure], list[Figure]]:
    """Return the figures by which WIL is nearer, farther, undecided; and those without interval."""
    known = [figure for figure in figures if figure.nearer_interval is not None]
    return (
        [one for one in known if one.holds is True],
        [one for one in known if one.holds is False],
        [one for one in known if one.holds is None],
        [figure for figure in figures if figure.nearer_interval is None],
    )


def _names(figures: Iterable[Figure]) -> str:
    return ", ".join(_MEASURE_NAMES.get(figure.measure, figure.measure) for figure in figures)


def _on_disagreement(
    means: Sequence[GapFigure], energies: Sequence[EnergyFigure]
) -> Iterator[Conclusion]:
    """Yield why the two measures of the gap contradict each other, where they do."""
    against = {gap_figure.measure: gap_figure for gap_figure in means if gap_figure.holds is False}
    both = [energy for energy in energies if energy.holds is True and energy.measure in against]
    if not both:
        return
    first = both[0]
    spreads = [first.within_sim, first.within_wil, first.within_real]
    known = [value for value in spreads if value is not None]
    if len(known) < len(spreads) or min(known) != first.within_sim:
        return
    sim, wil, real = (f"{value:.3f}" for value in known)
    yield Conclusion(
        "note",
        "Why these two disagree: a mean distance is small for a mode whose flights lie close "
        f"together, and those of simulation do ({first.measure} between two flights of one mode: "
        f"simulation {sim}, WIL {wil}, reality {real}). The second measure corrects for that.",
    )


def _needed_for_gap(figures: Sequence[Figure], flown: int) -> Iterator[Conclusion]:
    """Yield how many flights would decide: an interval shrinks with the square root of them."""
    texts = []
    for figure in figures:
        times = _times_for_decision(figure.nearer_by, figure.nearer_interval)
        if times is not None and flown:
            texts.append(f"{math.ceil(flown * times)} for {_names([figure])}")
    if texts:
        yield Conclusion(
            "needed",
            f"Flights of each case and mode needed to decide ({flown} now), if differences and "
            f"spread stay the same: about {', '.join(texts)}.",
        )


def _times_for_decision(nearer_by: float | None, interval: RateInterval | None) -> float | None:
    """Return the multiple of the flights that moves an interval off 0; None for too many."""
    if not nearer_by or interval is None:
        return None
    half = nearer_by - interval.low if nearer_by > 0.0 else interval.high - nearer_by
    times = (half / nearer_by) ** 2
    return times if 1.0 < times <= _MOST_TIMES else None


def _of_published(study: Study) -> Iterator[Conclusion]:
    """Yield the source of the published counts shown beside the campaign's own."""
    if not study.published.passed:
        return
    counts = []
    for mode in MODES:
        texts = [text for (_, one), text in study.published.passed.items() if one == mode]
        known = [each for text in texts if (each := counts_in(text)) is not None]
        if known:
            total = f"{sum(a for a, _ in known)} of {sum(b for _, b in known)}"
            counts.append(f"{MODE_NAMES[mode]} {total}")
    totals = f": passes {', '.join(counts)}" if counts else ""
    source = study.published.source or "a source that the campaign file does not name"
    yield Conclusion(
        "note",
        f"Columns named published are not from this campaign: they are the counts of {source}"
        f"{totals}. They are shown for comparison and do not affect the verdict.",
    )
