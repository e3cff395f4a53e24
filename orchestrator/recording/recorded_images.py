"""The images of a recording: from its file, or drawn again from what it has of them.

An image that this program drew follows from the world, the camera and the poses of what moves. The
recording has these and a digest, and here it is drawn again. One whose digest differs is refused:
it is not the image that was flown with.
"""

import json
import math
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

import cv2
from mcap.records import Message
from numpy.typing import NDArray

from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.foundation.files.limits import MAX_IMAGE_PIXELS
from wil_campaign.orchestrator.installation import flown_program
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap.mcap_bodies import image_digest_of, jpeg_of_image
from wil_campaign.orchestrator.recording.recording_facts import quality_in, scene_digest, world_in
from wil_campaign.vehicles.cameras.camera_effects import NOISE_ROLL_PX
from wil_campaign.vehicles.perception.depth_colors import common_far_m
from wil_campaign.vehicles.readings import Drawing
from wil_campaign.vehicles.readings.image_messages import (
    camera_of_message,
    drawing_of_message,
    image_of_message,
)
from wil_campaign.vehicles.readings.messages import Json, bytes_from_base64
from wil_campaign.vehicles.readings.traits import Parts
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.world_file.world_schema import Mode, Which

if TYPE_CHECKING:  # readers of a recording load the renderer where an image is drawn again
    from wil_campaign.vehicles.sensors.drawn_again import ImageRedrawer

_WORLDS: Mapping[str, Which] = {"real": "W", "twin": "Wv"}
"""The world that a vehicle's images are of."""


_LEAST_PX, _MOST_PX = 1e-3, 1e9
_LEAST_TURN, _MOST_TURN = 0.1, 10.0
"""Lengths of quaternions; of rotations they are about 1."""


class NotDrawnAgainError(RecordingError):
    """An image that was not recorded cannot be drawn again; says which one, and why."""


class _Drawer(NamedTuple):
    """What draws the images of one scene. digest: of its shapes."""

    again: "ImageRedrawer"
    digest: str


class _OtherShapesError(Exception):
    """The shapes of a world are no longer those of a flight; has what draws those of now."""

    def __init__(self, drawer: _Drawer) -> None:
        super().__init__()
        self.drawer = drawer


class RecordedImages:
    """The images of one recording. facts: of its beginning."""

    def __init__(self, facts: Mapping[str, str]) -> None:
        self._facts = facts
        self._drawers: dict[str, _Drawer] = {}
        self._refused: dict[str, str] = {}

    def image(self, document: Json) -> NDArray[Any]:
        """Return the pixels of a message of an image.

        Raises NotDrawnAgainError; KeyError, ValueError or TypeError for a foreign document.
        """
        drawn = self.drawn(document)
        return image_of_message(document) if drawn is None else drawn["image"]

    def far_m(self, messages: Iterable[Message]) -> float | None:
        """Return the end of one scale for the depths of messages, metres; None without depths.

        Messages of other types, of other programs or damaged ones do not count.
        """
        depths = list(filter(None, map(self._far_m, messages)))
        return max(depths, default=None)

    def _far_m(self, message: Message) -> float | None:
        try:
            document = json.loads(message.data)
            is_depth = document["wil"]["type"] == "depth"
            return common_far_m([self.image(document)]) if is_depth else None
        except (NotDrawnAgainError, KeyError, ValueError, TypeError, AttributeError, cv2.error):
            return None

    def is_encoded(self, document: Json) -> bool:
        """Return whether an image is a JPEG or PNG in the recording, or would be, had it to be."""
        return "format" in document or "drawing" in document["wil"]

    def encoded(self, document: Json) -> tuple[str, bytes]:
        """Return format and bytes of an image: as recorded, or as JPEG, as they would have been.

        Raises as `image` does.
        """
        drawn = self.drawn(document)
        if drawn is None:
            return document["format"], bytes_from_base64(document["data"])
        return "jpeg", jpeg_of_image(drawn["image"], quality_in(self._facts))

    def drawn(self, document: Json) -> Parts | None:
        """Return an image that is not in the recording, by part; None for one that is.

        The parts are "image" and, as in flight, "depth" and "ids". Raises as `image` does.
        """
        wil = document["wil"]
        if "drawing" not in wil:
            return None
        source, name = wil["source"], f"{wil['source']}/{wil.get('sensor', 'camera')}"
        drawer = self._drawer(source)
        why = self._refused.get(source, "")
        if drawer is not None:
            try:
                found = _draw(drawer.again, document)
            except (OverflowError, cv2.error) as error:  # of numbers, or a lens, that no flight has
                raise ValueError(str(error)) from error
            if found is not None:
                return found
            why = self._why_other(source, drawer)
        raise NotDrawnAgainError(
            f"the image of {name} at {wil['t_s']:.3f} s is not in the recording and cannot be "
            f"drawn again: {why}"
        )

    def _drawer(self, source: str) -> _Drawer | None:
        """Return what draws the images of a vehicle; None where that was refused before."""
        if source in self._refused:
            return None
        if source not in self._drawers:
            self._find_drawer(source)
        return self._drawers.get(source)

    def _find_drawer(self, source: str) -> None:
        """Find what draws the images of a vehicle, or why there is nothing."""
        world, mode = self._facts.get("world"), self._facts.get("mode")
        if world is None or mode not in get_args(Mode) or source not in _WORLDS:
            self._refused[source] = "the recording has no world"
            return
        file, flown = self._facts.get("world_file", ""), self._facts.get(f"shapes_{source}")
        try:
            self._drawers[source] = _drawer(world, file, mode, _WORLDS[source], flown)
        except _OtherShapesError as other:
            self._drawers[source] = other.drawer
        except BadInput as error:
            first = error.problems[0]
            self._refused[source] = f"its world cannot be read: {first.file}: {first.message}"

    def _why_other(self, source: str, drawer: _Drawer) -> str:
        """Return why the image that is drawn now is not that of the flight, in words."""
        flown, here = self._facts.get("program", "an unknown version"), flown_program()
        whys = []
        if self._facts.get(f"shapes_{source}", drawer.digest) != drawer.digest:
            whys.append("meshes or textures of the world have changed since")
        if flown != here:
            whys.append(f"it was flown by {flown}, and this is {here}")
        why = " and ".join(whys) or "this machine or its libraries draw differently"
        return f"it would not be the same image; {why}"


def _draw(again: "ImageRedrawer", document: Json) -> Parts | None:
    """Return an image that is drawn again, by part; None where it is another than in flight."""
    wanted, digests = document["wil"]["drawing"], document["wil"]["drawing"]["crc32"]
    drawing, (intrinsics, _) = drawing_of_message(wanted), camera_of_message(document)
    _require_drawable(drawing, intrinsics)
    try:
        image = again.image(
            drawing, intrinsics, want_depth="depth" in digests, want_ids="ids" in digests
        )
    except ValueError:  # other bodies move
        return None
    found = {"image": image.image_bgr, "depth": image.depth_m, "ids": image.object_ids}
    parts = {part: array for part, array in found.items() if array is not None}
    if {part: image_digest_of(array) for part, array in parts.items()} != digests:
        return None
    for array in parts.values():
        array.setflags(write=False)
    return parts


def _require_drawable(drawing: Drawing, camera: Intrinsics) -> None:
    """Raise ValueError for what no flight has drawn: kernels check nothing, and would crash.

    A recording may come from elsewhere, or be damaged: anything may stand in it.
    """
    sizes, focal_px = (camera.width_px, camera.height_px), (camera.fx_px, camera.fy_px)
    if any(type(one) is not int or one < 1 for one in sizes) or math.prod(sizes) > MAX_IMAGE_PIXELS:
        raise ValueError(f"an image of {sizes[0]} x {sizes[1]} pixels")
    if not all(_LEAST_PX < one < _MOST_PX for one in focal_px):
        raise ValueError(f"a camera with focal lengths of {focal_px[0]} and {focal_px[1]} pixels")
    if not all(abs(one) < _MOST_PX for one in (camera.cx_px, camera.cy_px)):
        raise ValueError(f"a camera with its axis at ({camera.cx_px}, {camera.cy_px})")
    for pose in (drawing.camera_pose, *drawing.moving):
        if not all(map(math.isfinite, pose.position_ned_m)):
            raise ValueError(f"a position of {pose.position_ned_m}")
        if not _LEAST_TURN < math.hypot(*pose.q_wxyz) < _MOST_TURN:
            raise ValueError(f"a quaternion of {pose.q_wxyz}")
    done = drawing.effects
    if done is not None and not all(0 <= one <= NOISE_ROLL_PX for one in done.noise_roll_px):
        raise ValueError(f"noise that is moved by {done.noise_roll_px}")


@lru_cache(maxsize=4)
def _drawer(world: str, file: str, mode: Mode, which: Which, flown: str | None) -> _Drawer:
    """Return what draws a scene; cached, as runs share worlds. flown: the digest of its shapes.

    Meshes are in files, which change between runs: only the shapes of the flight are kept, and not
    those that a file had when it was read first. Raises BadInput, _OtherShapesError.
    """
    from wil_campaign.vehicles.sensors.drawn_again import ImageRedrawer  # noqa: PLC0415 - kernels

    found = world_in({"world": world, "world_file": file})
    assert found is not None  # noqa: S101 - the fact is given
    scene = found.scene(mode, which)
    drawer = _Drawer(ImageRedrawer(scene), scene_digest(scene))
    if flown is not None and drawer.digest != flown:
        raise _OtherShapesError(drawer)
    return drawer
