"""The statistics of a campaign as rows and sentences, for the terminal and the report; pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from wil_campaign.plugins.statistics.conclusions import MODE_NAMES
from wil_campaign.plugins.statistics.gap.energy import EnergyFigure
from wil_campaign.plugins.statistics.gap.gap import TOO_FEW, GapFigure
from wil_campaign.plugins.statistics.inference.probability_text import p_text
from wil_campaign.plugins.statistics.pass_rates import MODES, ModeTest, PassRate
from wil_campaign.plugins.statistics.proportions import RateInterval
from wil_campaign.plugins.statistics.published import counts_in
from wil_campaign.plugins.statistics.study import Study

NONE = "-"

_GAP_HEAD = (
    "case",
    "part",
    "measure",
    "real to sim",
    "real to wil",
    "real to real",
    "gap closed",
    "nearer by",
    "wil nearer",
)
_ENERGY_HEAD = (
    "case",
    "part",
    "measure",
    "within real",
    "within sim",
    "within wil",
    "energy real to sim",
    "energy real to wil",
    "nearer by",
    "wil nearer",
)
_SPEED_HEAD = (
    "case",
    "object",
    "mode",
    "flights",
    "mean speed",
    "SD in a flight",
    "SD of the means",
)
_ANSWERS = {True: "yes", False: "no", None: "undecided"}


@dataclass(frozen=True, slots=True)
class StudyTable:
    """A table: the head, and rows of as many texts."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def result_rows(study: Study) -> StudyTable:
    """Return passes and failures by case and mode, laid out as the paper's Table I.

    Each count has its interval; published counts of the campaign file get columns of their own.
    """
    rates = {(rate.case, rate.mode): rate for rate in study.rates.rates}
    published = study.published.passed
    cases = dict.fromkeys([*(case for case, _ in rates), *(case for case, _ in published)])
    modes = [one for one in MODES if any(mode == one for _, mode in (*rates, *published))]
    head = ["case"]
    for mode in modes:
        head += [MODE_NAMES[mode], *(["published"] if published else [])]
    rows = []
    for case in cases:
        row = [case]
        for mode in modes:
            row.append(_rate_text(rates.get((case, mode))))
            if published:
                row.append(_published_text(published.get((case, mode), "")))
        rows.append(tuple(row))
    return StudyTable(tuple(head), tuple(rows))


def gap_rows(study: Study) -> StudyTable:
    """Return the gap by case and measure."""
    return StudyTable(_GAP_HEAD, tuple(_gap_row(figure) for figure in study.gap.figures))


def energy_rows(study: Study) -> StudyTable:
    """Return the energy distances by case and measure: the gap corrected for spread.

    Empty unless a case has two flights of reality and two of another mode.
    """
    figures = study.gap.energies
    is_known = any(figure.sim is not None or figure.wil is not None for figure in figures)
    return StudyTable(_ENERGY_HEAD, tuple(map(_energy_row, figures)) if is_known else ())


def speed_rows(study: Study) -> StudyTable:
    """Return the speeds of moving objects by case and mode, m/s."""
    rows = (
        (
            speed.case,
            speed.object,
            MODE_NAMES.get(speed.mode, speed.mode),
            str(speed.flights),
            _speed(speed.mean_m_s),
            _speed(speed.within_m_s),
            _speed(speed.between_m_s),
        )
        for speed in study.speeds
    )
    return StudyTable(_SPEED_HEAD, tuple(rows))


def _speed(value_m_s: float | None) -> str:
    return NONE if value_m_s is None else f"{value_m_s:.2f} m/s"


def study_statements(study: Study) -> list[str]:
    """Return tests, agreement and what was left out, in sentences."""
    found = [_test_text(test) for test in study.rates.tests]
    found += [
        f"{MODE_NAMES[agreement.mode]} agrees with reality on whether there are failures in "
        f"{agreement.cases_agree} of {agreement.cases} cases; two flights, one of each, have the "
        f"same verdict with probability {agreement.verdicts_agree:.2f}"
        for agreement in study.rates.agreement
    ]
    found += list(_bases(study.gap.figures))
    if study.published.source:
        found.append(f"published: {study.published.source}")
    return [*found, *(f"not compared: {text}" for text in study.gap.left_out)]


def has_modes_to_compare(study: Study) -> bool:
    """Return whether reality was flown beside another mode, or counts were published."""
    modes = {rate.mode for rate in study.rates.rates}
    return bool(study.published.passed) or ("real" in modes and len(modes) > 1)


def interval_text(interval: RateInterval | None, digits: int) -> str:
    """Return an interval as [low, high]; empty for none."""
    return "" if interval is None else f"[{interval.low:.{digits}f}, {interval.high:.{digits}f}]"


def _rate_text(rate: PassRate | None) -> str:
    if rate is None:
        return NONE
    text = f"P {rate.passed} F {rate.flown - rate.passed}"
    if rate.deterministic:
        text += " equal runs"
    elif rate.interval is not None:
        text += f" {rate.interval.rate_text}"
    return f"{text} +{rate.unproven} unproven" if rate.unproven else text


def _published_text(text: str) -> str:
    """Return published counts in the format of the table; other texts unchanged."""
    if (counts := counts_in(text)) is not None:
        passed, flown = counts
        return f"P {passed} F {flown - passed}"
    return text or NONE


def _test_text(test: ModeTest) -> str:
    where = test.case or "all cases"
    kind = "Fisher's exact test" if test.case else "exact test stratified by case"
    names = f"{MODE_NAMES[test.one]} and {MODE_NAMES[test.other]}"
    if test.p is None:
        return f"{names}, {where}: no test, {test.why}"
    return f"{names}, {where}: p {p_text(test.p)} ({kind}{f'; {test.why}' if test.why else ''})"


def _gap_row(figure: GapFigure) -> tuple[str, ...]:
    closed = NONE if figure.closed_percent is None else f"{figure.closed_percent:.0f} %"
    nearer = _number(figure.nearer_by)
    if figure.nearer_interval is not None:
        closed = f"{closed} {interval_text(figure.closed_interval, 0)}".rstrip()
        nearer = f"{nearer} {interval_text(figure.nearer_interval, 3)}"
    return (
        figure.case,
        figure.part,
        figure.measure,
        _number(figure.real_to_sim),
        _number(figure.real_to_wil),
        _number(figure.real_to_real),
        closed,
        nearer,
        _holds_text(figure),
    )


def _energy_row(figure: EnergyFigure) -> tuple[str, ...]:
    nearer = _number(figure.nearer_by)
    if figure.nearer_interval is not None:
        nearer = f"{nearer} {interval_text(figure.nearer_interval, 3)}"
    return (
        figure.case,
        figure.part,
        figure.measure,
        _number(figure.within_real),
        _number(figure.within_sim),
        _number(figure.within_wil),
        _number(figure.sim),
        _number(figure.wil),
        nearer,
        _energy_holds_text(figure),
    )


def _holds_text(figure: GapFigure) -> str:
    if figure.nearer_by is None:
        return NONE
    if figure.nearer_interval is None:
        return "no interval" if figure.basis.endswith(TOO_FEW) else "no spread"
    return _ANSWERS[figure.holds]


def _energy_holds_text(figure: EnergyFigure) -> str:
    if figure.nearer_by is None:
        return NONE
    if figure.nearer_interval is None:
        has_spread = any((figure.within_real, figure.within_sim, figure.within_wil))
        return "no interval" if has_spread else "no spread"
    return _ANSWERS[figure.holds]


def _bases(figures: Sequence[GapFigure]) -> Iterator[str]:
    texts = dict.fromkeys(f"gap of {figure.case}: {figure.basis}" for figure in figures)
    yield from texts


def _number(value: float | None) -> str:
    return NONE if value is None else f"{value:.3f}"
