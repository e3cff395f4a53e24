"""The result of a search as text: a table of failures, and the sentences beneath it."""

from collections.abc import Iterator

from wil_campaign.orchestrator.cli.text_table import table
from wil_campaign.plugins.search.exploration.coverage import coverage_of
from wil_campaign.plugins.search.exploration.model import FailingCase
from wil_campaign.plugins.search.exploration.search_campaign import SearchCampaign
from wil_campaign.plugins.search.search_document import unsettled_texts
from wil_campaign.plugins.search.search_runner import SearchOutcome


def search_text(search: SearchCampaign, outcome: SearchOutcome) -> str:
    """Return the result of a search, for a terminal."""
    found = outcome.findings
    rows = [
        (
            one.variant.name,
            one.mode,
            one.standing,
            f"{one.failed}/{one.proven}",
            _interval_text(one),
            one.causes_text,
            _changes_text(search, one),
            outcome.files.get(one.variant.name, ""),
        )
        for one in found.cases
    ]
    heads = ("variant", "mode", "standing", "failed", "rate", "cause", "reduced to", "file")
    shown = [f"{table(heads, rows)}\n"] if rows else []
    return "\n".join([*shown, *_sentences(search, outcome)])


def _sentences(search: SearchCampaign, outcome: SearchOutcome) -> Iterator[str]:
    found = outcome.findings
    failed = sum(one.failed(mode) for one in found.tried for mode in list(one.outcomes)[-1:])
    yield (
        f"{search.campaign.name}: {len(found.tried)} variants flown, {failed} failed, "
        f"{len(found.confirmed)} confirmed; {len(found.refused)} refused before a flight; "
        f"{outcome.ended}"
    )
    yield from unsettled_texts(found)
    for gap in found.gaps:
        spread = "" if gap.spread is None else f", spread {gap.spread:.3f}"
        mean = "not measured" if gap.mean is None else f"mean {gap.mean:+.3f}{spread}"
        pairs = len(gap.differences)
        yield f"gap from {gap.lower} to {gap.upper}: {mean} of the objective, by {pairs} pairs"
    for (mode, purpose), cost in found.costs.items():
        yield f"{mode}, {purpose}: {cost.flights} flights, {cost.flight_s:.0f} s in flight"
    covered = coverage_of(search.space, [one.variant.values for one in found.tried])
    yield f"coverage: {covered.flown} of {covered.cells} pairs of cells ({covered.share:.0%})"


def _interval_text(case: FailingCase) -> str:
    interval = case.interval
    return "" if interval is None else f"[{interval.low:.2f}, {interval.high:.2f}]"


def _changes_text(search: SearchCampaign, case: FailingCase) -> str:
    if case.standing != "confirmed":
        return ""
    units = {one.name: one.unit for one in search.space.parameters}
    return ", ".join(
        f"{name} {value} {units[name]}".rstrip() for name, value in case.reduced.values.items()
    )
