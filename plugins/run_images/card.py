"""The card of a run: its moment as one picture, with verdict, images and plan."""

from collections.abc import Sequence

from wil_campaign.orchestrator.report.model import RunReport
from wil_campaign.orchestrator.report.rendering.page import role_of
from wil_campaign.orchestrator.report.words import MODES, NOTHING, short_time
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
    doubt = "" if run.result is None else run.result.doubt
    wrapped = sheet.wrapped(headline_text(run), 22, _ROOM_PX, 1 if doubt else 2)
    lines = [(line, INK) for line in wrapped]
    lines += [(sheet.fitted(doubt, 22, _ROOM_PX), VERDICTS["INVALID"])] if doubt else []
    _draw_head(sheet, f"{campaign}  {run.name}", run, lines)
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


def role_mark(run: RunReport) -> tuple[str, Rgb, Rgb]:
    """Return the role of a run in words, their colour, and that of its verdict."""
    result = run.result
    role, verdict = role_of(run), "" if result is None else result.verdict
    colour = VERDICTS.get(verdict, DIM)
    if result is None or result.control is None:
        return role, DIM, colour
    # A control that passed is no success, and one that failed as it has to is no failure.
    return (role, DIM, DIM) if result.control.met else (role, VERDICTS["FAIL"], VERDICTS["FAIL"])


def _draw_head(
    sheet: DrawingSheet, name: str, run: RunReport, lines: Sequence[tuple[str, Rgb]]
) -> None:
    verdict = "NO RESULT" if run.result is None else run.result.verdict
    role, role_colour, colour = role_mark(run)
    left = _MARGIN + sheet.badge((_MARGIN, 26), verdict, 22, colour) + 16
    room = SIZE_PX[0] - _MARGIN - left - sheet.width_of(role, 22) - 16
    left += sheet.text((left, 30), sheet.fitted(name, 22, room), 22) + 16
    sheet.text((left, 30), role, 22, role_colour)
    for row, (line, colour) in enumerate(lines):
        sheet.text((_MARGIN, 70 + 30 * row), line, 22, colour)


def _mode_text(run: RunReport) -> str:
    """Return what flew in a mode without a mixture."""
    return f": {MODES[run.mode]}" if run.mode in MODES and run.mode != "wil" else ""


def _draw_facts(
    sheet: DrawingSheet, run: RunReport, images: ImagesAtTime | None, note: str
) -> None:
    left, top = _MARGIN + _STEP_PX, _PLAN_TOP
    room = sheet.width - _MARGIN - left
    texts = [f"{name}: {text}" for name, text in (() if run.cause is None else run.cause.facts)]
    if run.success is not None:
        texts = [
            f"{m.name} held" if m.measured == NOTHING else f"{m.name} {m.measured} ({m.limit})"
            for m in run.success.margins
        ]
    if run.moment is not None:
        text = f"the moment: {short_time(run.moment.t_s, run.goal_s)} since the goal"
        if images is not None and images.t_s != run.moment.t_s:
            text += f"; images {run.moment.t_s - images.t_s:.1f} s before it"
        texts.insert(0, text)
    for row, text in enumerate(texts[:7]):
        sheet.text((left, top + 25 * row), sheet.fitted(text, 16, room), 16)
    flown = "world-in-the-loop flight" if run.mode == "wil" else f"mode {run.mode}"
    feet = (f"Tested in {flown} by wil-campaign" + _mode_text(run), note)
    for row, foot in enumerate(feet):
        sheet.text((left, top + 184 + 19 * row), sheet.fitted(foot, 14, room), 14, DIM)
