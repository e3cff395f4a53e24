"""Names of marked objects in an image: within it, and clear of each other."""

import re

import pytest

from wil_campaign.orchestrator.report.model import ObjectMark, PageImage, PerceivedSight
from wil_campaign.orchestrator.report.rendering.image_marks import marks_svg

WIDTH_PX, HEIGHT_PX = 320, 240
NAME = re.compile(r'<text x="([\d.]+)" y="([\d.]+)" font-size="([\d.]+)">([^<]+)</text>')

Corners = tuple[float, float, float, float]


def names_of(*marks: ObjectMark) -> list[tuple[str, float, float, float, float]]:
    """Return name, left, top, right and bottom of each drawn name."""
    frame = PageImage("mixed", 1.0, 1.0, WIDTH_PX, HEIGHT_PX, "")
    svg = marks_svg(PerceivedSight(1.0, frame, marks=marks))
    found = []
    for x, y, size, name in NAME.findall(str(svg)):
        left, bottom, height = float(x), float(y), float(size)
        found.append((name, left, bottom - height, left + 0.62 * height * len(name), bottom))
    return found


@pytest.mark.parametrize(
    "corners",
    [
        [(100, 100, 140, 140)] * 3,
        [(100, 100, 140, 140), (108, 102, 150, 150), (90, 98, 120, 160)],
        [(290, 2, 318, 40), (280, 4, 318, 60), (300, 3, 318, 30)],
        [(280, 200, 318, 238), (285, 205, 318, 238), (270, 195, 318, 238)],
        [(2, 2, 318, 238), (2, 2, 318, 238), (2, 2, 318, 238)],
    ],
)
def test_names_stand_in_the_image_and_do_not_collide(corners: list[Corners]) -> None:
    found = names_of(*(ObjectMark(f"obstacle_{n}", 1.0, box) for n, box in enumerate(corners)))
    assert len(found) == len(corners)
    for _, left, top, right, bottom in found:
        assert left >= 0.0
        assert top >= -2.5, "capitals are lower than their line"
        assert right <= WIDTH_PX
        assert bottom <= HEIGHT_PX
    for n, (_, left, top, right, bottom) in enumerate(found):
        for _, left_2, top_2, right_2, bottom_2 in found[:n]:
            assert right <= left_2 or right_2 <= left or bottom <= top_2 or bottom_2 <= top


def test_a_single_name_stands_above_its_box() -> None:
    ((name, left, _, _, bottom),) = names_of(ObjectMark("gate", 1.0, (100, 100, 140, 140)))
    assert (name, left, bottom) == ("gate", 97.0, 93.0)
