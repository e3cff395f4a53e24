"""Places the names of a map's objects so that no two collide; pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from wil_campaign.orchestrator.report.model import Point

_LETTER = 5.8
"""Width of a letter in units of the drawing, at its font size of 10; names are bold."""
_HEIGHT = 11.0
_GAP = 5.0
_STEPS = 4
"""How many lines farther from its object a name may stand."""

Anchor = str
"""Of a text: start, middle or end."""


@dataclass(frozen=True, slots=True)
class LabelBox:
    """A rectangle of the drawing: x to the right, y down."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: "LabelBox") -> bool:
        """Return whether two rectangles overlap."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )

    def is_within(self, other: "LabelBox") -> bool:
        """Return whether this rectangle lies in the other."""
        return (
            other.left <= self.left
            and self.right <= other.right
            and other.top <= self.top
            and self.bottom <= other.bottom
        )


@dataclass(frozen=True, slots=True)
class PlacedName:
    """A name, and where its text begins, is centred, or ends. leader: the place it is led to."""

    name: str
    at: Point
    anchor: Anchor
    leader: Point | None = None


def place_names(
    wanted: Sequence[tuple[str, LabelBox]], taken: Sequence[LabelBox], area: LabelBox
) -> list[PlacedName]:
    """Return the names of objects beside their boxes, in the area, and clear of each other.

    A name goes above its object, else below, right or left, else farther off with a leader. taken:
    where no name may stand. A name without any free place is left out; the object has its title.
    """
    used, found = list(taken), []
    for name, box in wanted:
        for placed in _candidates(name, box):
            text = text_box(placed)
            if text.is_within(area) and not any(text.meets(one) for one in used):
                used.append(text)
                found.append(placed)
                break
    return found


def text_box(placed: PlacedName) -> LabelBox:
    """Return the rectangle that a name covers."""
    width = _LETTER * len(placed.name)
    x, y = placed.at
    left = x - {"start": 0.0, "middle": width / 2.0, "end": width}[placed.anchor]
    return LabelBox(left - 1.0, y - _HEIGHT + 2.0, left + width + 1.0, y + 2.0)


def _candidates(name: str, box: LabelBox) -> Iterator[PlacedName]:
    x, y = (box.left + box.right) / 2.0, (box.top + box.bottom) / 2.0
    yield PlacedName(name, (x, box.top - _GAP), "middle")
    yield PlacedName(name, (x, box.bottom + _HEIGHT + 1.0), "middle")
    yield PlacedName(name, (box.right + _GAP, y + 3.0), "start")
    yield PlacedName(name, (box.left - _GAP, y + 3.0), "end")
    for step in range(1, _STEPS + 1):
        off = step * (_HEIGHT + 1.0)
        yield PlacedName(name, (x, box.top - _GAP - off), "middle", (x, box.top))
        yield PlacedName(name, (x, box.bottom + _HEIGHT + 1.0 + off), "middle", (x, box.bottom))
        for anchor, side in (("start", box.right + _GAP), ("end", box.left - _GAP)):
            edge = box.right if anchor == "start" else box.left
            for sign in (-1.0, 1.0):
                yield PlacedName(name, (side, y + 3.0 + sign * off), anchor, (edge, y))
