"""The moment of a run in its report, as the campaign's observer sees it."""

from collections.abc import Iterator
from pathlib import Path

from wil_campaign.hooks import Section
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.recording.recording_facts import campaign_in
from wil_campaign.orchestrator.report.model import PageImage, RunReport
from wil_campaign.orchestrator.report.reading.recorded_sights import read_facts
from wil_campaign.orchestrator.report.reading.sight_decoding import page_image_of
from wil_campaign.orchestrator.report.rendering.page_parts import page_environment
from wil_campaign.orchestrator.report.words import short_time
from wil_campaign.plugins.observer.observed_run import (
    RECORDING,
    ObservedRun,
    ObserverCamera,
    read_observed_run,
)

_STRIP_S = (-2.0, -1.0, 0.0, 1.0, 2.0)
"""Times of the images, relative to the moment."""
_WIDTH_PX, _QUALITY = 480, 75


def observer_section(folder: Path, run: RunReport) -> Section:
    """Return what a run's observer saw around its moment; empty where the campaign has none.

    folder: of the campaign's results.
    """
    place = folder / run.name
    if run.moment is None or not campaign_in(read_facts(place / RECORDING)).get("observer"):
        return Section()
    try:
        seen = read_observed_run(place)
    except ResultsFolderError as error:
        return Section(problems=(f"the observer's images are left out: {error}",))
    template = page_environment("wil_campaign.plugins.observer").get_template("observer.html.j2")
    html = template.render(
        at_s=run.moment.t_s,
        frames=list(_frames(seen, run.moment.t_s)),
        is_mixed=run.mode == "wil",
        when=lambda t_s: short_time(t_s, run.goal_s),
    )
    return Section(html=html)


def _frames(seen: ObservedRun, at_s: float) -> Iterator[PageImage]:
    """Yield the images around a time, as far as poses are recorded; always that of the time."""
    camera = ObserverCamera(seen, seen.observer or seen.default_observer)
    begin_s, end_s = seen.span_s
    for offset_s in _STRIP_S:
        t_s = at_s + offset_s
        if offset_s and not begin_s <= t_s <= end_s:
            continue
        yield page_image_of(
            camera.draw(t_s),
            source="observer",
            t_s=t_s,
            delivered_s=t_s,
            width_px=_WIDTH_PX,
            quality=_QUALITY,
        )
