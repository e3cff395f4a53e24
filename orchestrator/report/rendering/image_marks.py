"""Marks on an image: a box round each relevant object, its name, the touched part; SVG; pure."""

from collections.abc import Iterator, Mapping

from markupsafe import Markup

from wil_campaign.orchestrator.report.model import ObjectMark, PageImage, PerceivedSight
from wil_campaign.orchestrator.report.rendering.map_labels import LabelBox
from wil_campaign.orchestrator.report.rendering.markup import points_text, svg_element

_PAD_PX = 3.0
_INSET_PX = 1.5
_TEXT_SHARE = 0.042
"""Text height as a share of the image width."""
_LETTER_SHARE = 0.62
"""Width of a bold letter as a share of its height."""
_MOST_ROWS = 12


def marks_svg(sight: PerceivedSight | None) -> Markup | None:
    """Return the marks of a sight as an overlay of its image; None without any."""
    if sight is None or not isinstance(sight.perceived, PageImage):
        return None
    frame = sight.perceived
    boxes = {mark.name: box for mark in sight.marks if (box := _box(mark, frame)) is not None}
    drawn = [shape for mark in sight.marks for shape in _mark(mark, boxes.get(mark.name))]
    drawn += _names(boxes, frame)
    if not drawn:
        return None
    view = f"0 0 {frame.width_px} {frame.height_px}"
    names = ", ".join(mark.name for mark in sight.marks if mark.box_px is not None)
    attributes = {
        "class": "marks",
        "viewBox": view,
        "role": "img",
        "aria-label": f"marked: {names}",
    }
    return svg_element("svg", attributes, drawn)


def _box(mark: ObjectMark, frame: PageImage) -> LabelBox | None:
    """Return the box of a mark within the image; None where the object is out of view."""
    if mark.box_px is None:
        return None
    left, top = (max(_INSET_PX, value - _PAD_PX) for value in mark.box_px[:2])
    right = min(frame.width_px - _INSET_PX, mark.box_px[2] + _PAD_PX)
    bottom = min(frame.height_px - _INSET_PX, mark.box_px[3] + _PAD_PX)
    return LabelBox(left, top, right, bottom)


def _mark(mark: ObjectMark, box: LabelBox | None) -> Iterator[Markup]:
    if box is None:
        return
    size = {"width": box.right - box.left, "height": box.bottom - box.top}
    place = {"x": box.left, "y": box.top, **size}
    for kind in ("halo", "box"):
        yield svg_element("rect", {"class": kind, **place})
    if len(mark.outline_px) > 2:
        points = points_text(mark.outline_px)
        yield svg_element("polygon", {"class": "touched", "points": points})


def _names(boxes: Mapping[str, LabelBox], frame: PageImage) -> Iterator[Markup]:
    """Yield the names of marks, in the image and clear of each other.

    A name stands above its box, else at the top in it, else below the box; where others take
    these, so many lines lower.
    """
    size = _TEXT_SHARE * frame.width_px
    taken: list[LabelBox] = []
    for name, box in boxes.items():
        width = _LETTER_SHARE * size * len(name)
        most_left = max(_INSET_PX, frame.width_px - width - _INSET_PX)
        places = [
            (box.left, box.top - 4.0),
            (box.left + 4.0, box.top + size + 1.0),
            (box.left, box.bottom + size + 1.0),
            *((box.left + 4.0, box.top + (row + 2) * size * 1.15) for row in range(_MOST_ROWS)),
        ]
        spots = [(min(x, most_left), y) for x, y in places if y >= size - 2.0]
        texts = [
            (spot, LabelBox(spot[0], spot[1] - size, spot[0] + width, spot[1])) for spot in spots
        ]
        inside = [one for one in texts if one[1].bottom <= frame.height_px]
        clear = [one for one in inside if not any(one[1].meets(other) for other in taken)]
        spot, text = next(iter(clear or inside or texts))
        taken.append(text)
        yield svg_element("text", {"x": spot[0], "y": spot[1], "font-size": size}, [name])
