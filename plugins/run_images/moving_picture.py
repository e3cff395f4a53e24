"""The moving picture of a run: its flight from the goal on, with images and plan, as a GIF."""

import itertools
from collections.abc import Sequence
from typing import BinaryIO

from PIL import Image

from wil_campaign.orchestrator.report.model import Point, RunReport
from wil_campaign.plugins.run_images.card import headline_text, role_mark
from wil_campaign.plugins.run_images.drawing import (
    DIM,
    FENCE,
    INK,
    SUBJECTS,
    VERDICTS,
    DrawingSheet,
)
from wil_campaign.plugins.run_images.plan import PlanBox, draw_plan
from wil_campaign.plugins.run_images.recorded_images import ImagesAtTime

SIZE_PX = (760, 222)
_MARGIN = 8
_IMAGE_PX = 196
_TOP = 62
_PLAN_PX = (132, 147)
_MOST_FRAMES = 44
_LEAST_STEP_S = 0.2
_COLOURS = 56
_SAMPLES = 5
_SWATCH_PX = 40
_LAST_MS = 2500
_AFTER_S = 1.0


def frame_times(run: RunReport) -> list[float]:
    """Return the times of the frames: from the goal, or the beginning, to just after the end."""
    stages = dict(run.stages)
    begin_s = run.goal_s if run.goal_s is not None else run.span_s[0]
    ends = [stages[name] + _AFTER_S for name in ("done", "land") if name in stages]
    if run.cause is not None and run.cause.at_s is not None:
        ends.append(run.cause.at_s + 2.0 * _AFTER_S)
    end_s = min([*ends, run.span_s[1]])
    step_s = max(_LEAST_STEP_S, (end_s - begin_s) / _MOST_FRAMES)
    count = max(1, int((end_s - begin_s) / step_s) + 1)
    return [begin_s + k * step_s for k in range(count)]


def write_gif(
    stream: BinaryIO, run: RunReport, campaign: str, images: Sequence[ImagesAtTime]
) -> None:
    """Write the moving picture. images: at the times of the frames."""
    frames = [_frame(run, campaign, image, is_last=image is images[-1]) for image in images]
    steps = [b.t_s - a.t_s for a, b in itertools.pairwise(images)]
    durations_ms = [max(20, round(1000.0 * step)) for step in steps] + [_LAST_MS]
    palette = _palette(frames)
    reduced = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    reduced[0].save(
        stream,
        format="GIF",
        save_all=True,
        append_images=reduced[1:],
        duration=durations_ms,
        loop=0,
        optimize=True,
    )


def _palette(frames: Sequence[Image.Image]) -> Image.Image:
    """Return an image with the colours of all frames; those that carry meaning are always there."""
    chosen = frames[:: max(1, len(frames) // _SAMPLES)]
    swatches = [*SUBJECTS.values(), FENCE, INK, *{VERDICTS[name] for name in ("PASS", "FAIL")}]
    width, height = SIZE_PX
    sample = Image.new("RGB", (width, height * len(chosen) + _SWATCH_PX * len(swatches)))
    for k, image in enumerate(chosen):
        sample.paste(image, (0, height * k))
    for k, colour in enumerate(swatches):
        top = height * len(chosen) + _SWATCH_PX * k
        sample.paste(colour, (0, top, width, top + _SWATCH_PX))
    return sample.quantize(_COLOURS, dither=Image.Dither.NONE)


def _frame(run: RunReport, campaign: str, images: ImagesAtTime, *, is_last: bool) -> Image.Image:
    sheet = DrawingSheet(*SIZE_PX)
    since_s = images.t_s - (run.goal_s or 0.0)
    time_text = f"{since_s:4.1f} s since the goal" + _clearance_text(run, images.t_s)
    name = f"{campaign}  {run.name}"
    left = max(_MARGIN + 240, 2 * _MARGIN + sheet.width_of(name, 15))
    left = min(left, sheet.width - _MARGIN - sheet.width_of(time_text, 15))
    sheet.text((_MARGIN, 8), sheet.fitted(name, 15, left - 2 * _MARGIN), 15)
    sheet.text((left, 8), time_text, 15, DIM)
    if is_last and run.result is not None:
        role, role_colour, colour = role_mark(run)
        left = 2 * _MARGIN + sheet.badge((_MARGIN, 28), run.result.verdict, 11, colour)
        left += sheet.text((left, 29), role, 12, role_colour) + _MARGIN
        line = sheet.fitted(headline_text(run), 12, sheet.width - left - _MARGIN)
        sheet.text((left, 29), line, 12)
    for column, source in enumerate(("real", "twin", "mixed")):
        left = _MARGIN + column * (_IMAGE_PX + 6)
        sheet.text((left, _TOP - 15), source, 12, SUBJECTS[source])
        if source in images.images_bgr:
            sheet.paste(images.images_bgr[source], (left, _TOP), _IMAGE_PX)
    if images.far_m is not None:
        sheet.depth_key((_MARGIN, _TOP + _PLAN_PX[1]), 9, images.far_m)
    left = _MARGIN + 3 * (_IMAGE_PX + 6)
    sheet.text((left, _TOP - 15), "plan", 12, DIM)
    draw_plan(sheet, run, PlanBox(left, _TOP, *_PLAN_PX), until_s=images.t_s)
    return sheet.image


def _clearance_text(run: RunReport, t_s: float) -> str:
    """Return the clearance of the judged vehicle at a time."""
    subject = "twin" if run.mode == "sim" else "real"
    for plot in run.plots:
        for curve in plot.curves:
            if plot.title == "clearance" and curve.subject == subject and curve.points:
                return f",  clearance {_value_at(curve.points, t_s):.2f} m"
    return ""


def _value_at(points: Sequence[Point], t_s: float) -> float:
    return min(points, key=lambda one: abs(one[0] - t_s))[1]
