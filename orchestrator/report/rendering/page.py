"""Renders the report page from the reading model; everything from a file is escaped; pure."""

import json
import re
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from urllib.parse import quote

import yaml
from markupsafe import Markup

from wil_campaign.installed_plugins import load_plugin_object
from wil_campaign.orchestrator.reading.model import CampaignDocuments
from wil_campaign.orchestrator.report.model import (
    PageImage,
    PerceivedSight,
    RunReport,
    SketchedReading,
)
from wil_campaign.orchestrator.report.rendering import overview
from wil_campaign.orchestrator.report.rendering.image_marks import marks_svg
from wil_campaign.orchestrator.report.rendering.map_svg import map_svg
from wil_campaign.orchestrator.report.rendering.markup import visible_text
from wil_campaign.orchestrator.report.rendering.page_parts import page_environment, render_template
from wil_campaign.orchestrator.report.rendering.plot_svg import (
    closeup_svg,
    plot_svg,
    stage_axis_svg,
    time_axis_svg,
)
from wil_campaign.orchestrator.report.words import MODES, number_text, short_time
from wil_campaign.orchestrator.run_results.result_parts import distinct_firmware
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.vehicles.readings.kinds import traits_named

NO_RESULT = "NO RESULT"
_MOST_PROBLEMS = 12
"""Lines about damaged runs at the head of the page."""


def sketch_of_sight(sight: PerceivedSight | None) -> Markup | None:
    """Return the perceived reading over those it was mixed from, drawn by its type; else None."""
    if sight is None or not isinstance(sight.perceived, SketchedReading):
        return None
    kind = sight.perceived.kind
    shown = [
        one.document
        for one in (*sight.beside, sight.perceived)
        if isinstance(one, SketchedReading) and one.kind == kind
    ]
    drawn: Markup | None = load_plugin_object(traits_named(kind).sketch)(shown)
    return drawn


@dataclass(frozen=True, slots=True)
class RunPage:
    """A run's section of the page, and its row in the overview; texts as shown.

    badge: the CSS class of the verdict: `met` or `unmet` for a control.
    """

    anchor: str
    name: str
    case: str
    mode: str
    rep: str
    verdict: str
    badge: str
    role: str
    headline: str
    reason: str
    duration_s: str
    margin: str
    is_bad: bool
    decides: bool
    html: Markup
    problems: tuple[str, ...] = ()


def render_run(
    run: RunReport,
    *,
    anchor: str,
    video: str | None = None,
    stand_in: str = "",
    sections: Iterable[str] = (),
) -> RunPage:
    """Return a run's section of the page. video: a data URI; None links to the file.

    stand_in: a text that no hardware flew as `real`; shown where `real` flew. sections: of plugins,
    as HTML.
    """
    result = run.result
    verdict = NO_RESULT if result is None else result.verdict
    html = (
        page_environment()
        .get_template("run.html.j2")
        .render(
            run=run,
            result=result,
            anchor=anchor,
            verdict=verdict,
            badge=_badge(result),
            is_met=_is_met(result),
            is_bad=went_wrong(result),
            role=role_of(run),
            mode_text=MODES.get(run.mode, ""),
            stand_in="" if run.mode == "sim" else stand_in,
            virtual=[
                outline.name
                for outline in run.world.outlines
                if outline.is_virtual and not outline.is_room
            ],
            physical=[outline.name for outline in run.world.outlines if not outline.is_virtual],
            flown=[track.vehicle for track in run.tracks],
            subject="twin" if run.mode == "sim" else "real",
            maps=[found for view in ("above", "side") if (found := map_svg(run, view))],
            plots=[(plot, plot_svg(plot, run)) for plot in run.plots],
            time_axis=time_axis_svg(run),
            stage_axis=stage_axis_svg(run),
            scan=sketch_of_sight(run.sight),
            strip=[sight for sight in run.strip if isinstance(sight.perceived, PageImage)],
            frames=_frames(run.sight),
            marks=marks_svg(run.sight),
            closeup=None if run.closeup is None else closeup_svg(run.closeup, run.goal_s),
            video=video or _link(run.name, run.video),
            video_command=shlex.join(("wil-campaign", "report", ".", "--video", run.name)),
            files=[(name, _link(run.name, name)) for name in run.files],
            sections=[Markup(html) for html in sections if html],  # noqa: S704 - as of the page's
            when=lambda t_s: short_time(t_s, run.goal_s),
        )
    )
    return RunPage(
        anchor=anchor,
        name=run.name,
        case=run.case,
        mode=run.mode,
        rep=run.rep,
        verdict=verdict,
        badge=_badge(result),
        role=role_of(run),
        headline="" if run.cause is None else run.cause.headline,
        reason="" if result is None else result.reason,
        duration_s=number_text(None if result is None else result.duration_s, digits=1),
        margin=overview.margin_text(result),
        is_bad=went_wrong(result),
        decides=decides_verdict(result),
        html=Markup(html),  # noqa: S704 - from the template above, which escapes
        problems=run.problems,
    )


def render_page(
    documents: CampaignDocuments,
    sections: Iterable[str],
    pages: Sequence[RunPage],
    *,
    made_utc: str,
) -> str:
    """Return the whole page. sections: of plugins, as HTML."""
    return render_template(
        "page.html.j2",
        script="script.js",
        campaign=documents,
        manifest=documents.manifest,
        firmware=distinct_firmware(
            flown_firmware
            for entry in documents.entries
            if entry.result
            for flown_firmware in entry.result.firmware
        ),
        verdict=overview.campaign_verdict_of(documents),
        grounds=overview.verdict_grounds(documents),
        cautions=overview.verdict_cautions(documents),
        rows=overview.case_rows(documents),
        sections=[Markup(html) for html in sections],  # noqa: S704 - escaped, by hooks.Section
        pages=pages,
        limits=overview.validity_limits(documents),
        deciding=[page for page in pages if page.is_bad and page.decides],
        others=[page for page in pages if page.is_bad and not page.decides],
        problems=[*documents.problems, *_run_problems(pages)],
        document=_document_text(documents),
        made_utc=made_utc,
    )


def _run_problems(pages: Sequence[RunPage]) -> list[str]:
    """Return what is missing or damaged in runs, for the head of the page: the first of it.

    Runs without a result are counted and listed there already.
    """
    found = [
        f"{page.name}: {text}"
        for page in pages
        if page.verdict != NO_RESULT
        for text in page.problems
    ]
    if len(found) <= _MOST_PROBLEMS:
        return found
    more = len(found) - _MOST_PROBLEMS + 1
    return [*found[: _MOST_PROBLEMS - 1], f"and {more} more: the pages of the runs have them"]


def page_anchors(names: Iterable[str]) -> list[str]:
    """Return a unique HTML id for each name, of letters that need no escaping."""
    found: list[str] = []
    for name in names:
        plain = "run-" + re.sub(r"[^A-Za-z0-9_-]+", "-", name)
        found.append(plain if plain not in found else f"{plain}-{len(found)}")
    return found


def role_of(run: RunReport) -> str:
    """Return the role of a run: required, reported only, or a control and whether it was met.

    With the number of its attempt, where it is not the first.
    """
    result = run.result
    if result is None:
        return ""
    role = "required" if result.required else "reported only"
    if result.control is not None:
        role = "control, met" if result.control.met else "control, NOT met"
    return f"{role}, attempt {len(result.attempts) + 1}" if result.attempts else role


def _is_met(result: RunResult | None) -> bool:
    """Return whether a run is a control that ended as required."""
    return result is not None and result.control is not None and result.control.met


def _badge(result: RunResult | None) -> str:
    if result is None:
        return "NO-RESULT"
    if result.control is None:
        return result.verdict
    return "met" if result.control.met else "unmet"  # a control that passed is not green


def decides_verdict(result: RunResult | None) -> bool:
    """Return whether a run counts for the campaign's verdict: required, a control, or no result."""
    return result is None or result.required or result.control is not None


def went_wrong(result: RunResult | None) -> bool:
    """Return whether a run has no result, or went wrong."""
    return result is None or result.went_wrong


def _frames(sight: PerceivedSight | None) -> list[PageImage]:
    """Return the images of the moment: the perceived one, then those it was mixed from."""
    if sight is None:
        return []
    return [frame for frame in (sight.perceived, *sight.beside) if isinstance(frame, PageImage)]


def _link(run: str, name: str | None) -> str | None:
    """Return a relative link to a file of a run, with its name escaped."""
    return None if name is None else "./" + quote(f"{run}/{name}")


def _document_text(documents: CampaignDocuments) -> str:
    document = documents.manifest.get("document")
    if document is None:
        return ""
    try:
        return visible_text(
            yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100)
        )
    except yaml.YAMLError:
        return json.dumps(document, indent=2, default=str)
