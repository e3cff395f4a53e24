"""Rendered cameras: one that takes images at its rate, and one that renders on demand from a pose.

Images come from an ImageSource: this program's renderer, or a simulator in another process. A
heavy job goes through `CameraCompute`: inline under virtual time, in a thread under the wall clock.
"""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.vehicles.cameras.camera_effects import (
    NO_STREAK,
    NOISE_ROLL_PX,
    CameraEffects,
    CameraQuality,
    Streak,
    motion_streak_px,
)
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import (
    BgrImage,
    CameraReading,
    DepthImage,
    Drawing,
    IdImage,
    Source,
)
from wil_campaign.worlds.camera import CameraMount, Intrinsics
from wil_campaign.worlds.frames import Pose

__all__ = [
    "CameraCompute",
    "CameraQuality",
    "ImageSource",
    "NoImageError",
    "OnDemandCamera",
    "RenderedCamera",
    "RenderedImage",
    "compute_inline",
    "deliver_due_readings",
    "next_camera_tick",
]

MAX_POSE_AGE_S = 0.25
"""A vehicle whose pose is older than this delivers no images, rather than frozen ones."""

MAX_JITTER_SIGMA = 3.0

T = TypeVar("T")


class NoImageError(VehicleError):
    """A rendered camera got no image for an exposure: it was late, refused, or wrong."""


class RenderedImage(Protocol):
    """A rendered image: colours, and depth and ids where requested."""

    @property
    def image_bgr(self) -> BgrImage:
        """Return the rendered colours, (height, width, 3) uint8."""

    @property
    def depth_m(self) -> DepthImage | None:
        """Return the rendered depth, (height, width) float32 along the axis, inf: nothing."""

    @property
    def object_ids(self) -> IdImage | None:
        """Return the rendered ids, (height, width) uint8, 0 for the background."""


class ImageSource(Protocol):
    """Renders images of a world from a pose at a time (protocol)."""

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
    ) -> RenderedImage:
        """Return a rendered image of the caller's own. Raises NoImageError."""


def moving_bodies_in_image(image: RenderedImage) -> tuple[Pose, ...] | None:
    """Return where moving bodies stood in an image; None for one that this program did not draw."""
    found: tuple[Pose, ...] | None = getattr(image, "moving", None)
    return found


class CameraCompute(Protocol):
    """Runs a rendered camera's long jobs, and awaits them (protocol)."""

    def __call__(self, job: Callable[[], T], /) -> Awaitable[T]:
        """Return what the job returns."""


async def compute_inline(job: Callable[[], T], /) -> T:
    """Run a camera's job here, as virtual time wants it; else `asyncio.to_thread`."""
    return job()


@dataclass(frozen=True, slots=True)
class _Exposure:
    """One exposure of a rendered camera."""

    seq: int
    t_s: float
    due_s: float
    camera_pose: Pose
    streak_px: Streak
    noise_roll_px: tuple[int, int]


class RenderedCamera:
    """A rendered camera that delivers images at its rate, with its effects.

    history: the body's true poses. Exposures have their middle at the start + k / rate_hz; one
    that cannot be taken (no pose, or the last image is not ready) is left out, and its number with
    it. An image is delivered `latency_s`, with jitter, after the middle of its exposure, in order,
    and never before the shutter closed. pose_delay_s: how long after the exposure its pose is
    looked up, for poses that arrive late. on_missing: called with the reason when the source gave
    no image; that exposure is left out.
    """

    def __init__(
        self,
        *,
        source: ImageSource,
        history: PoseHistory,
        intrinsics: Intrinsics,
        rate_hz: float,
        side: Source,
        rng: np.random.Generator,
        mount: CameraMount | None = None,
        quality: CameraQuality | None = None,
        compute: CameraCompute = compute_inline,
        pose_delay_s: float = 0.0,
        on_missing: Callable[[str], None] | None = None,
    ) -> None:
        self._on_missing = on_missing
        self._source = source
        self._history = history
        self._intrinsics = intrinsics
        self._rate_hz = rate_hz
        self._side: Source = side
        self._rng = rng
        self._mount = mount or CameraMount()
        self._quality = quality or CameraQuality()
        self._effects = CameraEffects(self._quality, intrinsics, rng)
        self._compute = compute
        self._pose_delay_s = pose_delay_s
        self.left_out = 0

    async def run(self, deliver: Callable[[CameraReading], None]) -> None:
        """Render and deliver images until cancelled; what `deliver` raises ends it."""
        ready: asyncio.Queue[CameraReading] = asyncio.Queue()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._expose(ready), name=f"{self._side} camera exposures")
            tasks.create_task(
                deliver_due_readings(ready, deliver), name=f"{self._side} camera delivery"
            )

    async def _expose(self, ready: asyncio.Queue[CameraReading]) -> None:
        start_s, seq, earliest_s = asyncio.get_running_loop().time(), 0, 0.0
        shutter_s = self._quality.exposure_s / 2.0 + self._pose_delay_s
        while True:
            t_s = start_s + seq / self._rate_hz
            await sleep_until(t_s + shutter_s)
            exposure = self._exposure(seq, t_s, earliest_s)
            if exposure is None:
                self.left_out += 1
            else:
                earliest_s = exposure.due_s
                await self._expose_one(exposure, ready)
            behind_s = asyncio.get_running_loop().time() - shutter_s - start_s
            following = max(seq + 1, next_camera_tick(behind_s, self._rate_hz))
            self.left_out += following - seq - 1
            seq = following

    async def _expose_one(self, exposure: _Exposure, ready: asyncio.Queue[CameraReading]) -> None:
        try:
            ready.put_nowait(await self._render_exposure(exposure))
        except NoImageError as error:
            self.left_out += 1
            if self._on_missing is not None:
                self._on_missing(str(error))

    def _exposure(self, seq: int, t_s: float, earliest_s: float) -> _Exposure | None:
        """Return what to render for one exposure; None without the body's pose."""
        jitter = float(np.clip(self._rng.standard_normal(), -MAX_JITTER_SIGMA, MAX_JITTER_SIGMA))
        down, right = (int(n) for n in self._rng.integers(0, NOISE_ROLL_PX + 1, 2))
        half_s = self._quality.exposure_s / 2.0
        delay_s = max(half_s, self._quality.latency_s + jitter * self._quality.jitter_s)
        pose = self._camera_pose(t_s)
        if pose is None:
            return None
        streak = self._streak_of(t_s, half_s) if half_s > 0.0 else NO_STREAK
        due_s = max(t_s + delay_s, earliest_s)
        return _Exposure(seq, t_s, due_s, pose, streak, (down, right))

    def _streak_of(self, t_s: float, half_s: float) -> Streak:
        start, end = self._camera_pose(t_s - half_s), self._camera_pose(t_s + half_s)
        if start is None or end is None:
            return NO_STREAK
        return motion_streak_px(start, end, self._intrinsics)

    def _camera_pose(self, t_s: float) -> Pose | None:
        found = self._history.at(t_s)
        if found.pose is None or found.gap_s > MAX_POSE_AGE_S:
            return None
        return self._mount.camera_pose(found.pose)

    async def _render_exposure(self, exposure: _Exposure) -> CameraReading:
        streak, roll = exposure.streak_px, exposure.noise_roll_px

        def job() -> tuple[BgrImage, Drawing | None]:
            raw = self._source.picture(exposure.camera_pose, self._intrinsics, exposure.t_s)
            image = self._effects.apply(raw.image_bgr, streak_px=streak, noise_roll_px=roll)
            moving = moving_bodies_in_image(raw)
            if moving is None:
                return image, None
            return image, Drawing(exposure.camera_pose, moving, self._effects.drawn(streak, roll))

        image, drawing = await self._compute(job)
        return CameraReading(
            t_s=exposure.t_s,
            arrived_s=exposure.due_s,
            seq=exposure.seq,
            source=self._side,
            image_bgr=image,
            intrinsics=self._intrinsics,
            # The twin's pose is known, and serves to measure how well its image is registered.
            camera_pose=exposure.camera_pose if self._side == "twin" else None,
            drawing=drawing,
        )


class OnDemandCamera:
    """The twin's rendered camera on demand: an image from a given body pose, ideal.

    mount: of the camera whose image it has to match, that of the real vehicle.
    """

    def __init__(
        self,
        *,
        source: ImageSource,
        intrinsics: Intrinsics,
        mount: CameraMount | None = None,
        side: Source = "twin",
        compute: CameraCompute = compute_inline,
    ) -> None:
        self._source = source
        self._intrinsics = intrinsics
        self._mount = mount or CameraMount()
        self._side: Source = side
        self._compute = compute
        self._seq = 0

    async def ask(
        self, body: Pose, t_s: float, *, want_depth: bool = False, want_ids: bool = False
    ) -> CameraReading:
        """Return the image rendered from a body's pose (world frame) at t_s.

        Raises NoImageError.
        """
        camera_pose = self._mount.camera_pose(body)
        seq, self._seq = self._seq, self._seq + 1

        def job() -> RenderedImage:
            return self._source.picture(
                camera_pose, self._intrinsics, t_s, want_depth=want_depth, want_ids=want_ids
            )

        image = await self._compute(job)
        moving = moving_bodies_in_image(image)
        return CameraReading(
            t_s=t_s,
            arrived_s=asyncio.get_running_loop().time(),
            seq=seq,
            source=self._side,
            image_bgr=image.image_bgr,
            intrinsics=self._intrinsics,
            depth_m=image.depth_m,
            object_ids=image.object_ids,
            camera_pose=camera_pose,
            drawing=None if moving is None else Drawing(camera_pose, moving),
        )


def next_camera_tick(elapsed_s: float, rate_hz: float) -> int:
    """Return the number of the first camera tick k / rate_hz that is not over yet."""
    return int(np.ceil(elapsed_s * rate_hz - 1e-6))


async def deliver_due_readings(ready: asyncio.Queue[Any], deliver: Callable[[Any], None]) -> None:
    """Deliver each queued reading at its `arrived_s`, stamped with the time of delivery."""
    while True:
        reading = await ready.get()
        await sleep_until(reading.arrived_s)
        deliver(replace(reading, arrived_s=asyncio.get_running_loop().time()))
