"""What the program does with the readings of a class: one record for each, its traits.

A sensor type names it in its `SensorSpec`, the core's as those of plugins; readings of numbers
alone need none.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings.faults import ReadingFault
from wil_campaign.vehicles.readings.images import Source
from wil_campaign.vehicles.readings.messages import Json, Schema
from wil_campaign.worlds.frames import Pose, norm, subtract
from wil_campaign.worlds.geodesy import LocalFrame

Parts = Mapping[str, NDArray[Any]]
"""Arrays beside an image's message: "depth", "ids" and, of one that was drawn again, "image"."""
Encoded = tuple[dict[str, Json], bytes | None]
"""The fields of a reading's message, with those of `wil`, and the bytes of its field `data`."""
Quantity = Callable[[Any], float | NDArray[np.float32] | None]
"""One number for the whole reading, or one per element; None where the reading has none."""

_MOVED_M = 0.5


def has_moved_half_a_metre(reading: Any, since: Pose, now: Pose) -> bool:
    """Return whether a vehicle moved so far that readings of most types cannot stay the same."""
    del reading
    return norm(subtract(now.position_ned_m, since.position_ned_m)) > _MOVED_M


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingTraits:
    """The traits of a class of readings: what is left out is that of numbers alone.

    fault: returns what is wrong with one, or None. schema: of its message in run.mcap (`stamped`),
    one of Foxglove's where that fits. encode: returns that message's fields; None for images, whose
    form the campaign chooses. decode: returns a reading's fields, without its stamps, of such a
    message; raises KeyError, ValueError or TypeError. compared: what to compare with the last one,
    to find a frozen sensor; empty for a reading without a hit. has_moved: whether a vehicle moved
    so far between two poses that its readings cannot stay the same. blank: returns an empty one as
    large as those of a sensor, by its setup, of a side. size: that of one, in words. at_rest:
    returns what is wrong with one of a vehicle at rest, by its pose in the world. in_flight: makes
    what is given each of a sensor and its vehicle's pose then, and returns what contradicts.

    elements: its array with a value per element, counted by the first `axes`; "" for one value.
    in_world: whether its values are in the world's frame, not in its sensor's or the body's.
    overlaid: whether `overlay` takes it. mismatch: returns why two have other elements, or "".
    ground_truth: fields that only a simulator knows, None for an autonomy. line: makes what joins
    readings that last (`duration_s`), a `TimeLine` of recipes/working.py: of the twin's the part of
    the real one's time is mixed. is_large: whether it takes long to make, and much memory.
    may_be_empty: whether the twin's is, where its world has nothing within range. visibility:
    `module:name` of its Comparison (orchestrator/run/perception/visibility.py) with the virtual
    objects that it shows; "" for one that shows none. sketch: `module:name` of what draws recorded
    messages over each other in the report, as SVG or None; "" for none. quantities: what conditions
    can use of one.
    """

    fault: Callable[[Any], ReadingFault | None] | None = None
    schema: Schema | None = None
    encode: Callable[[Any], Encoded] | None = None
    decode: Callable[[Json, Parts], Mapping[str, Any]] | None = None
    compared: Callable[[Any], tuple[object, ...]] = lambda reading: ()  # noqa: ARG005
    has_moved: Callable[[Any, Pose, Pose], bool] = has_moved_half_a_metre
    blank: Callable[[Any, Source], Any] | None = None
    size: Callable[[Any], str] = lambda reading: ""  # noqa: ARG005
    at_rest: Callable[[Any, Pose, LocalFrame], str | None] | None = None
    in_flight: Callable[[], Callable[[Any, Pose], str | None]] | None = None
    elements: str = ""
    axes: int = 1
    in_world: bool = False
    overlaid: bool = False
    mismatch: Callable[[Any, Any], str] = lambda upper, lower: ""  # noqa: ARG005
    ground_truth: tuple[str, ...] = ()
    line: Callable[[], Any] | None = None
    is_large: bool = False
    may_be_empty: bool = False
    visibility: str = ""
    sketch: str = ""
    quantities: Mapping[str, Quantity] | None = None


NUMBERS = ReadingTraits()
