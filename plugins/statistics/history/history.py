"""History of campaigns: pass rates, margins, durations; flaky and stochastic flights; pure."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Literal

from wil_campaign.plugins.statistics.history.records import FlightRecord
from wil_campaign.plugins.statistics.proportions import RateInterval, clopper_pearson

Kind = Literal["flaky", "stochastic"]
_LONG_COMMIT = re.compile(r"\b([0-9a-f]{12})[0-9a-f]{28,52}\b")


@dataclass(frozen=True, slots=True)
class HistoryRow:
    """A case and mode of one campaign. margin, duration_s: medians; None without one.

    version: with twelve digits of its commit. interval: of the pass rate; None where several
    flights have equal figures. ending: why the campaign ended early, or has unmet controls, else
    empty; None where it was not recorded. settings: a digest of the test's; is_other: they differ
    from those of the row before of the case and mode, so that the two are not of one line.
    firmware: of the vehicles, in words; other_firmware: it is known, and another than that of the
    row before.
    """

    campaign: str
    started_utc: str
    version: str
    case: str
    mode: str
    passed: int
    flown: int
    unproven: int
    interval: RateInterval | None
    margin: float | None
    duration_s: float | None
    ending: str | None
    settings: str = ""
    is_other: bool = False
    firmware: str = ""
    other_firmware: bool = False


@dataclass(frozen=True, slots=True)
class VerdictVariation:
    """Flights of a case and mode with the same inputs and different verdicts.

    flaky: under one seed of the virtual clock, which must repeat: a defect of program or test.
    stochastic: under different seeds, as expected.
    """

    kind: Kind
    campaign: str
    case: str
    mode: str
    text: str


def history_rows(records: Iterable[FlightRecord]) -> list[HistoryRow]:
    """Return a row for each case and mode of each campaign, oldest first."""
    groups: dict[tuple[str, ...], list[FlightRecord]] = {}
    for one in sorted(records, key=lambda one: (one.campaign, one.started_utc)):
        flight = (one.campaign, one.started_utc, one.host, one.case, one.mode)
        groups.setdefault((*flight, one.settings, one.firmware), []).append(one)
    rows = [_row(group) for group in groups.values()]
    rows.sort(key=lambda row: (row.campaign, row.case, row.mode, row.started_utc))
    return [_marked(row, before) for before, row in zip([None, *rows], rows, strict=False)]


def _marked(row: HistoryRow, before: HistoryRow | None) -> HistoryRow:
    """Return a row, marked where its settings differ from those before; unknown ones differ."""
    if before is None or _line_of(row) != _line_of(before):
        return row
    known = bool(row.firmware and before.firmware)
    return replace(
        row,
        is_other=row.settings != before.settings,
        other_firmware=known and row.firmware != before.firmware,
    )


def _line_of(row: HistoryRow) -> tuple[str, str, str]:
    """Return what flights have in common that stand in one line over time."""
    return (row.campaign, row.case, row.mode)


def verdict_variations(records: Iterable[FlightRecord]) -> list[VerdictVariation]:
    """Return flights that varied under the same inputs: flaky first.

    Under any clock but the virtual one a seed does not repeat a flight, so nothing is flaky.
    """
    groups: dict[tuple[str, str, str, str], list[FlightRecord]] = {}
    for one in records:
        if one.verdict in {"PASS", "FAIL"}:
            groups.setdefault((one.campaign, one.case, one.mode, one.inputs), []).append(one)
    found = [each for group in groups.values() for each in _variations_of(group)]
    return sorted(found, key=lambda one: (one.kind, one.campaign, one.case, one.mode))


def _row(group: Sequence[FlightRecord]) -> HistoryRow:
    first = group[0]
    proven = [flight_record for flight_record in group if flight_record.verdict in {"PASS", "FAIL"}]
    passed = sum(flight_record.verdict == "PASS" for flight_record in proven)
    margins = [flight_record.margin for flight_record in proven if flight_record.margin is not None]
    durations = [
        flight_record.duration_s for flight_record in proven if flight_record.duration_s is not None
    ]
    figures = {
        (flight_record.verdict, flight_record.margin, flight_record.duration_s)
        for flight_record in proven
    }
    equal = len(proven) > 1 and len(figures) == 1 and bool(margins or durations)
    return HistoryRow(
        campaign=first.campaign,
        started_utc=first.started_utc,
        version=_LONG_COMMIT.sub(r"\1", first.version),
        case=first.case,
        mode=first.mode,
        passed=passed,
        flown=len(proven),
        unproven=len(group) - len(proven),
        interval=None if equal else clopper_pearson(passed, len(proven)),
        margin=median(margins) if margins else None,
        duration_s=median(durations) if durations else None,
        ending=group[-1].ending,
        settings=first.settings,
        firmware=first.firmware,
    )


def _variations_of(group: Sequence[FlightRecord]) -> list[VerdictVariation]:
    first = group[0]
    by_seed: dict[int, list[FlightRecord]] = {}
    for flight_record in group:
        by_seed.setdefault(flight_record.seed, []).append(flight_record)
    found = []
    torn = {seed: runs for seed, runs in by_seed.items() if len({r.verdict for r in runs}) > 1}
    named = (first.campaign, first.case, first.mode)
    if first.clock == "virtual":
        for seed, runs in torn.items():
            verdicts = ", ".join(f"{run.verdict} in {run.started_utc} #{run.rep}" for run in runs)
            found.append(VerdictVariation("flaky", *named, f"seed {seed}: {verdicts}"))
    settled = {runs[0].verdict for seed, runs in by_seed.items() if seed not in torn}
    if len(settled) > 1 or (torn and first.clock != "virtual"):
        passed = sum(flight_record.verdict == "PASS" for flight_record in group)
        text = f"{passed} of {len(group)} flights passed, over {len(by_seed)} seeds"
        if torn and first.clock != "virtual":
            text += f"; under the {first.clock} clock a seed does not repeat a flight"
        found.append(VerdictVariation("stochastic", *named, text))
    return found
