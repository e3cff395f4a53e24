"""The card of a run: its moment as one picture, with verdict, images and plan."""

from collections.abc import Sequence

from wil_campaign.orchestrator.report.model import RunReport
from wil_campaign.orchestrator.report.words import short_time
from wil_campaign.plugins.run_images.drawing import DIM, INK, SUBJECTS, VERDICTS, DrawingSheet, Rgb
from wil_campaign.plugins.run_images.plan import PlanBox, draw_plan
from wil_campaign.plugins.run_images.recorded_images import ImagesAtTime

SIZE_PX = (1200, 675)
_MARGIN = 32
_ROOM_PX = SIZE_PX[0] - 2 * _MARGIN
_IMAGE_PX = 330
_STEP_PX = 403
_IMAGES_TOP = 156
_PLAN_TOP = 426
_PLAN_PX = (330, 220)
_ORDER = ("real", "twin", "mixed")
_WORDS = {
    "real": "what the real vehicle's camera saw",
    "twin": "what the twin saw there",
    "mixed": "what the autonomy was given",
}


def draw_card(
    run: RunReport, campaign: str, images: ImagesAtTime | None, note: str = ""
) -> DrawingSheet:
    """Return the card of a run. images: of its moment. note: who flew as real, as a sentence."""
    sheet = DrawingSheet(*SIZE_PX)
    verdict = "NO RESULT" if run.result is None else run.result.verdict
    doubt = "" if run.result is None else run.result.doubt
    wrapped = sheet.wrapped(headline_text(run), 22, _ROOM_PX, 1 if doubt else 2)
    lines = [(line, INK) for line in wrapped]
    lines += [(sheet.fitted(doubt, 22, _ROOM_PX), VERDICTS["INVALID"])] if doubt else []
    _draw_head(sheet, f"{campaign}  {run.name}", verdict, lines)
    shown = {} if images is None else images.images_bgr
    for column, source in enumerate(_ORDER):
        left = _MARGIN + column * _STEP_PX
        width = sheet.text((left, _IMAGES_TOP - 24), source, 17, SUBJECTS[source])
        sheet.text((left + width + 10, _IMAGES_TOP - 22), _WORDS[source], 14, DIM)
        if source in shown:
            sheet.paste(shown[source], (left, _IMAGES_TOP), _IMAGE_PX)
        else:
            sheet.text((left, _IMAGES_TOP + 20), "not flown, or not recorded", 14, DIM)
    if images is not None and images.far_m is not None:
        sheet.depth_key((_MARGIN, _PLAN_TOP - 19), 13, images.far_m)
    draw_plan(sheet, run, PlanBox(_MARGIN, _PLAN_TOP, *_PLAN_PX))
    _draw_facts(sheet, run, images, note)
    return sheet


def headline_text(run: RunReport) -> str:
    """Return one sentence about how a run ended."""
    if run.success is not None:
        return run.success.sentence
    if run.cause is not None:
        return run.cause.headline or run.cause.sentence or run.cause.violated
    return "It has no result."


def _draw_head(
    sheet: DrawingSheet, name: str, verdict: str, lines: Sequence[tuple[str, Rgb]]
) -> None:
    width = sheet.badge((_MARGIN, 26), verdict, 22, VERDICTS.get(verdict, DIM))
    sheet.text((_MARGIN + width + 16, 30), name, 22)
    for row, (line, colour) in enumerate(lines):
        sheet.text((_MARGIN, 70 + 30 * row), line, 22, colour)


def _draw_facts(
    sheet: DrawingSheet, run: RunReport, images: ImagesAtTime | None, note: str
) -> None:
    left, top = _MARGIN + _STEP_PX, _PLAN_TOP
    room = sheet.width - _MARGIN - left
    texts = [f"{name}: {text}" for name, text in (() if run.cause is None else run.cause.facts)]
    if run.success is not None:
        texts = [f"{m.name} {m.measured} ({m.limit})" for m in run.success.margins]
    if run.moment is not None:
        text = f"the moment: {short_time(run.moment.t_s, run.goal_s)} since the goal"
        if images is not None and images.t_s != run.moment.t_s:
            text += f"; images {run.moment.t_s - images.t_s:.1f} s before it"
        texts.insert(0, text)
    for row, text in enumerate(texts[:7]):
        sheet.text((left, top + 25 * row), sheet.fitted(text, 16, room), 16)
    feet = ("Tested in world-in-the-loop flight by wil-campaign", note)
    for row, foot in enumerate(feet):
        sheet.text((left, top + 184 + 19 * row), sheet.fitted(foot, 14, room), 14, DIM)
