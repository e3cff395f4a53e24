"""Reads waypoint lists with fence items, as Mission Planner saves fences: the text QGC WPL 110.

After the first line a row of twelve numbers for each item: index, current, frame, command, four
parameters, latitude, longitude, altitude, autocontinue (https://mavlink.io/en/file_formats/). The
first row is home; MAVProxy saves a fence without it.
"""

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

from wil_campaign.foundation.files.documents import Data, Document, Path, rows_document

_HEAD = b"QGC WPL"
_BOM = b"\xef\xbb\xbf"
_NUMBER = re.compile(r"[-+]?(\d{1,40}\.?\d*|\.\d+)([eE][-+]?\d+)?")
ROWS = "items"
"""The key of the rows in the document of a waypoint list."""
_COLUMNS = 12
_HOME = 16
"""MAV_CMD_NAV_WAYPOINT: the command of home, which is no item of a fence."""


class WaypointRow(NamedTuple):
    """A row of a waypoint list: its path in the document, and what it says.

    first: its first parameter.
    """

    path: Path
    command: int
    first: float
    latitude_deg: float
    longitude_deg: float


def is_waypoint_list(content: bytes) -> bool:
    """Return whether a file's bytes are a waypoint list."""
    return content.removeprefix(_BOM).startswith(_HEAD)


def waypoint_document(content: bytes, *, name: str) -> Document:
    """Return the document of a waypoint list: its rows, with their places. Raises BadInput."""
    return rows_document(content, name=name, key=ROWS, value=_value)


def waypoint_rows(document: Document) -> Iterator[WaypointRow | Path]:
    """Yield a waypoint list's rows without home; the path alone of one that is no row."""
    rows = document.get((ROWS,))
    for index, row in enumerate(rows if isinstance(rows, list) else []):
        found = _row((ROWS, index), row)
        is_home = index == 0 and isinstance(found, WaypointRow) and found.command == _HOME
        if not is_home:
            yield found


def _row(path: Path, row: Data) -> WaypointRow | Path:
    """Return a row of a waypoint list; its path where it is not twelve numbers."""
    words = row if isinstance(row, list) else []
    numbers = [one for one in words if isinstance(one, int | float) and math.isfinite(one)]
    if len(words) != _COLUMNS or len(numbers) != _COLUMNS:
        return path
    return WaypointRow(
        path, int(numbers[3]), float(numbers[4]), float(numbers[8]), float(numbers[9])
    )


def _value(word: str) -> str | int | float:
    """Return a word of a row: a number where it is one."""
    if not _NUMBER.fullmatch(word):
        return word
    return int(word) if word.lstrip("+-").isdigit() else float(word)
