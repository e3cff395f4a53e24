"""Marks on an image: a box around each relevant object, and the touched part; SVG."""

from collections.abc import Iterator

from markupsafe import Markup

from wil_campaign.orchestrator.report.model import Frame, Mark, Sight
from wil_campaign.orchestrator.report.rendering.markup import element, points_text

_PAD_PX = 3.0
_INSET_PX = 1.5
_TEXT_SHARE = 0.042
"""Text height as a share of the image width."""


def marks_svg(sight: Sight | None) -> Markup | None:
    """Return the marks of a sight as an overlay of its image; None without any."""
    if sight is None or not isinstance(sight.perceived, Frame):
        return None
    frame = sight.perceived
    drawn = [shape for mark in sight.marks for shape in _mark(mark, frame)]
    if not drawn:
        return None
    box = f"0 0 {frame.width_px} {frame.height_px}"
    names = ", ".join(mark.name for mark in sight.marks if mark.box_px is not None)
    attributes = {"class": "marks", "viewBox": box, "role": "img", "aria-label": f"marked: {names}"}
    return element("svg", attributes, drawn)


def _mark(mark: Mark, frame: Frame) -> Iterator[Markup]:
    if mark.box_px is None:
        return
    left, top = (max(_INSET_PX, value - _PAD_PX) for value in mark.box_px[:2])
    right = min(frame.width_px - _INSET_PX, mark.box_px[2] + _PAD_PX)
    bottom = min(frame.height_px - _INSET_PX, mark.box_px[3] + _PAD_PX)
    place = {"x": left, "y": top, "width": right - left, "height": bottom - top}
    for kind in ("halo", "box"):
        yield element("rect", {"class": kind, **place})
    if len(mark.outline_px) > 2:
        points = points_text(mark.outline_px)
        yield element("polygon", {"class": "touched", "points": points})
    size = _TEXT_SHARE * frame.width_px
    inside = top < size + 2.0
    y = top + size + 1.0 if inside else top - 4.0
    text = {"x": left + (4.0 if inside else 0.0), "y": y, "font-size": size}
    yield element("text", text, [mark.name])
