"""A sheet to draw on: colours, texts, images and boxes, in pixels; origin at the top left."""

import unicodedata
from dataclasses import dataclass, field

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from wil_campaign.vehicles.perception.depth_colors import depth_scale
from wil_campaign.vehicles.readings import BgrImage

Rgb = tuple[int, int, int]
Spot = tuple[float, float]

PAGE: Rgb = (246, 247, 249)
CARD: Rgb = (255, 255, 255)
INK: Rgb = (26, 31, 38)
DIM: Rgb = (91, 102, 114)
RULE: Rgb = (216, 221, 227)
REAL: Rgb = (21, 101, 192)
TWIN: Rgb = (194, 24, 91)
FENCE: Rgb = (179, 38, 30)
SUBJECTS: dict[str, Rgb] = {"real": REAL, "twin": TWIN, "mixed": (46, 125, 50)}
VERDICTS: dict[str, Rgb] = {
    "PASS": (23, 111, 61),
    "FAIL": (179, 38, 30),
    "INVALID": (122, 86, 0),
    "ERROR": (107, 47, 160),
    "ABORTED": (11, 98, 119),
}
_REPLACED = str.maketrans("\N{EN DASH}\N{EM DASH}\N{MULTIPLICATION SIGN}", "--x")
_DRAWN = "\N{DEGREE SIGN}\N{PLUS-MINUS SIGN}\N{MIDDLE DOT}\N{RIGHT SINGLE QUOTATION MARK}"


@dataclass(slots=True)
class DrawingSheet:
    """A picture of width x height pixels while it is drawn."""

    width: int
    height: int
    image: Image.Image = field(init=False)
    pen: ImageDraw.ImageDraw = field(init=False)

    def __post_init__(self) -> None:
        self.image = Image.new("RGB", (self.width, self.height), PAGE)
        self.pen = ImageDraw.Draw(self.image)

    def text(self, at: Spot, text: str, size: int, colour: Rgb = INK) -> float:
        """Write a line with its top left at a place; return its width."""
        self.pen.text(at, drawable_text(text), colour, font=_font(size))
        return self.width_of(text, size)

    def width_of(self, text: str, size: int) -> float:
        """Return the width of a line."""
        return float(self.pen.textlength(drawable_text(text), font=_font(size)))

    def fitted(self, text: str, size: int, width: float) -> str:
        """Return a line, cut where it is wider than a width."""
        if self.width_of(text, size) <= width:
            return text
        while text and self.width_of(f"{text}…", size) > width:
            text = text[:-1]
        return f"{text.rstrip()}…"

    def wrapped(self, text: str, size: int, width: float, most: int) -> list[str]:
        """Return a text as at most so many lines of a width."""
        lines = [""]
        for word in text.split():
            longer = f"{lines[-1]} {word}".strip()
            if self.width_of(longer, size) <= width or not lines[-1]:
                lines[-1] = longer
            else:
                lines.append(word)
        if len(lines) > most:
            lines[most - 1 :] = [self.fitted(" ".join(lines[most - 1 :]), size, width)]
        return [self.fitted(line, size, width) for line in lines]

    def badge(self, at: Spot, text: str, size: int, colour: Rgb) -> float:
        """Write a word on a coloured box; return the width of the box."""
        width = self.width_of(text, size) + size
        box = (at[0], at[1], at[0] + width, at[1] + size * 1.5)
        self.pen.rounded_rectangle(box, size * 0.3, colour)
        self.text((at[0] + size * 0.5, at[1] + size * 0.2), text, size, CARD)
        return width

    def paste(self, image_bgr: BgrImage, at: Spot, width: int) -> int:
        """Put an image at a width; return its height."""
        height: int = max(1, round(image_bgr.shape[0] * width / image_bgr.shape[1]))
        small = cv2.resize(image_bgr, (width, height), interpolation=cv2.INTER_AREA)
        rgb = np.ascontiguousarray(small[:, :, ::-1]).astype(np.uint8)
        self.image.paste(Image.fromarray(rgb), (round(at[0]), round(at[1])))
        return height

    def depth_key(self, at: Spot, size: int, far_m: float) -> None:
        """Draw which colour is which depth up to far_m, as a line of a height."""
        left, top = at
        left += self.text((left, top), "depth: 0 m", size, DIM) + size
        self.paste(depth_scale(10 * size, size), (left, top + 0.15 * size), 10 * size)
        self.text((left + 11 * size, top), f"{far_m:g} m or farther, or no echo", size, DIM)


def drawable_text(text: str) -> str:
    """Return a text without letters that the font lacks: it draws a box in their place."""
    parts = unicodedata.normalize("NFKD", text.translate(_REPLACED))
    letters = [letter for letter in parts if not unicodedata.combining(letter)]
    return "".join(letter if letter.isascii() or letter in _DRAWN else "?" for letter in letters)


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the font that comes with Pillow: the same on every machine."""
    return ImageFont.load_default(size)
