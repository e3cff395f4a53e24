"""Faults of a vehicle's pictures, in virtual time: what its renderer gives is altered."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.faults.alterations import Alteration
from wil_campaign.orchestrator.run.perception.sensor_factory import SensorFactory
from wil_campaign.vehicles.cameras.rendered_cameras import ImageSource, NoImageError, RenderedImage
from wil_campaign.vehicles.readings import BgrImage, DepthImage, IdImage
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

_JUMPS_IMAGES = 10
_SHIFT_OF_WIDTH = 0.25
"""How far a picture is shifted for each metre of offset, as a part of its width."""


@dataclass(frozen=True, slots=True)
class AlteredImage:
    """An image as it goes on."""

    image_bgr: BgrImage
    depth_m: DepthImage | None
    object_ids: IdImage | None


class AlteredImages:
    """A source of images that alters them while `is_active` says so."""

    def __init__(
        self, source: ImageSource, alteration: Alteration, is_active: Callable[[], bool]
    ) -> None:
        self._source = source
        self._alteration = alteration
        self._is_active = is_active
        self._asked: list[tuple[float, Pose]] = []
        self._first: RenderedImage | None = None
        self._count = 0

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
    ) -> RenderedImage:
        """Return a picture of its own. Raises NoImageError."""

        def draw(pose: Pose) -> RenderedImage:
            return self._source.picture(
                pose, intrinsics, t_s, want_depth=want_depth, want_ids=want_ids
            )

        self._asked.append((t_s, camera_pose))
        if not self._is_active():
            return draw(camera_pose)
        self._count += 1
        kind = self._alteration.kind
        if kind == "stop":
            raise NoImageError("the fault stops it")
        if kind == "delay":
            return draw(self._pose_at(t_s - abs(self._alteration.step_s)))
        drawn = draw(camera_pose)
        if self._first is None:
            self._first = drawn
        if kind in {"freeze", "duplicate"}:
            return self._first
        if kind == "jump" and self._count % (2 * _JUMPS_IMAGES) >= _JUMPS_IMAGES:
            return drawn
        return altered_image(drawn, self._alteration)

    def _pose_at(self, t_s: float) -> Pose:
        before = [pose for asked_s, pose in self._asked if asked_s <= t_s]
        return before[-1] if before else self._asked[0][1]


def altered_image(drawn: RenderedImage, alteration: Alteration) -> AlteredImage:
    """Return a picture that is shifted, or white where it is to be no picture at all."""
    if alteration.kind == "nan":
        depth_m = drawn.depth_m
        white: Any = np.full_like(drawn.image_bgr, 255)
        nothing: Any = None if depth_m is None else np.full_like(depth_m, np.nan)
        return AlteredImage(white, nothing, drawn.object_ids)
    width = drawn.image_bgr.shape[1]
    by = tuple(round(_SHIFT_OF_WIDTH * width * one) for one in alteration.offset_m[:2])
    shifted: list[Any] = [
        None if part is None else np.ascontiguousarray(np.roll(part, by, axis=(0, 1)))
        for part in (drawn.image_bgr, drawn.depth_m, drawn.object_ids)
    ]
    return AlteredImage(*shifted)


@contextmanager
def altered_images(
    vehicle: str, alteration: Alteration, is_active: Callable[[], bool]
) -> Iterator[None]:
    """Alter the pictures of a vehicle's cameras in the runs that are flown meanwhile."""
    plain = SensorFactory._image_source

    def source(self: SensorFactory, name: str, sensor: str) -> ImageSource:
        found = plain(self, name, sensor)
        return AlteredImages(found, alteration, is_active) if name == vehicle else found

    SensorFactory._image_source = source  # type: ignore[method-assign]
    try:
        yield
    finally:
        SensorFactory._image_source = plain  # type: ignore[method-assign]
