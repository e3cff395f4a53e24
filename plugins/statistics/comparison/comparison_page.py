"""The page of a comparison: each case before and after, with intervals and settings; pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from wil_campaign.orchestrator.report.rendering.page_parts import render_template
from wil_campaign.plugins.statistics.comparison.comparison import FigureChange
from wil_campaign.plugins.statistics.comparison.settings import SettingsChanges
from wil_campaign.plugins.statistics.inference.probability_text import p_text
from wil_campaign.plugins.statistics.proportions import clopper_pearson
from wil_campaign.plugins.statistics.rate_svg import DrawnRate, rate_bar, rate_text

RATE = "pass rate"
_BADGES = {"worse": "bad", "not worse": "good", "undecided": "open"}


@dataclass(frozen=True, slots=True)
class LinkedFolder:
    """A results folder: its name, and the link to its report, empty without one."""

    name: str
    link: str


@dataclass(frozen=True, slots=True)
class _Row:
    change: FigureChange
    badge: str
    p: str
    before: str
    after: str
    bars: tuple[Markup, ...]


def render_comparison(
    changes: Sequence[FigureChange],
    settings: SettingsChanges,
    *,
    level: float,
    conclusion: str,
    sentences: Sequence[str],
    before: Sequence[LinkedFolder],
    after: LinkedFolder,
    made_utc: str,
) -> str:
    """Return the page as HTML. level: the largest p that is beyond chance.

    sentences: what else is to say, one point each.
    """
    return render_template(
        "compare.html.j2",
        package="wil_campaign.plugins.statistics",
        rows=[_row(change, level) for change in changes],
        settings=settings,
        conclusion=conclusion,
        is_worse=any(change.outcome == "worse" for change in changes),
        sentences=sentences,
        before=before,
        after=after,
        made_utc=made_utc,
    )


def _row(change: FigureChange, level: float) -> _Row:
    badge = _BADGES[change.outcome]
    p = "\N{EN DASH}" if change.p is None else p_text(change.p, level)
    if change.what == RATE:
        rates = [
            DrawnRate(passed, flown, None if equal else clopper_pearson(passed, flown))
            for share, flown, equal in zip(
                (change.before, change.after), change.flights, change.equal, strict=True
            )
            for passed in (round(share * flown),)
        ]
        before, after = (rate_text(rate) for rate in rates)
        return _Row(change, badge, p, before, after, tuple(rate_bar(rate) for rate in rates))
    before, after = (
        f"{'> ' if is_beyond else ''}{value:.3g} {change.unit}"
        for value, is_beyond in zip((change.before, change.after), change.is_beyond, strict=True)
    )
    return _Row(change, badge, p, before, after, ())
