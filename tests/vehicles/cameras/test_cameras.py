"""A rendered camera keeps its times, numbers and order, and its faults are as given."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.cameras.camera_effects import (
    NO_STREAK,
    CameraEffects,
    CameraQuality,
    blur_image,
    motion_streak_px,
)
from wil_campaign.vehicles.cameras.rendered_cameras import (
    OnDemandCamera,
    RenderedCamera,
    next_camera_tick,
)
from wil_campaign.vehicles.embedded.profile import load_profile
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import BgrImage, CameraReading, DepthImage, IdImage
from wil_campaign.worlds.camera import CameraMount, Intrinsics
from wil_campaign.worlds.frames import Pose, quat_from_euler

T = TypeVar("T")

CAMERA = Intrinsics.from_fov(64, 48, math.radians(69.0))


@dataclass(frozen=True)
class FakePicture:
    image_bgr: BgrImage
    depth_m: DepthImage | None = None
    object_ids: IdImage | None = None


class FakeSource:
    """Paints how far north the camera is, in centimetres, into every pixel."""

    def __init__(self) -> None:
        self.asked: list[tuple[Pose, float]] = []

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
    ) -> FakePicture:
        self.asked.append((camera_pose, t_s))
        level = round(camera_pose.position_ned_m[0] * 100)
        shape = (intrinsics.height_px, intrinsics.width_px)
        return FakePicture(
            np.full((*shape, 3), level, np.uint8),
            np.ones(shape, np.float32) if want_depth else None,
            np.ones(shape, np.uint8) if want_ids else None,
        )


async def fly_north(history: PoseHistory) -> None:
    """Move at 1 m/s, sampled at 250 Hz."""
    loop = asyncio.get_running_loop()
    for step in range(100_000):
        history.add(loop.time(), Pose((step * 0.004, 0.0, 0.0)), (1.0, 0.0, 0.0))
        await asyncio.sleep(0.004)


def record(
    duration_s: float = 1.02, quality: CameraQuality | None = None, seed: int = 1, **more: object
) -> tuple[list[tuple[float, CameraReading]], RenderedCamera]:
    """Run a camera at 20 Hz on a vehicle that flies north."""
    got: list[tuple[float, CameraReading]] = []

    async def main() -> RenderedCamera:
        history = PoseHistory(2.0)
        camera = RenderedCamera(
            source=FakeSource(),
            history=history,
            intrinsics=CAMERA,
            rate_hz=20.0,
            side="real",
            rng=np.random.default_rng(seed),
            quality=quality,
            **more,  # type: ignore[arg-type]  # as a test gives them
        )
        loop = asyncio.get_running_loop()
        flying = asyncio.create_task(fly_north(history))
        running = asyncio.create_task(
            camera.run(lambda reading: got.append((loop.time(), reading)))
        )
        await asyncio.sleep(duration_s)
        for task in (running, flying):
            task.cancel()
        await asyncio.gather(running, flying, return_exceptions=True)
        return camera

    return got, run_virtual(main())


def test_exposures_stand_at_the_ticks_and_come_late_by_the_latency() -> None:
    got, camera = record(quality=CameraQuality(latency_s=0.08))
    assert [reading.seq for _, reading in got] == list(range(19))
    for arrived_s, reading in got:
        assert reading.t_s == pytest.approx(reading.seq / 20, abs=1e-12)
        assert arrived_s == pytest.approx(reading.t_s + 0.08, abs=1e-12)
        assert reading.arrived_s == arrived_s
        assert (reading.source, reading.rendered, reading.intrinsics) == ("real", True, CAMERA)
    assert camera.left_out == 0


def test_the_picture_is_that_of_the_exposure_not_of_the_delivery() -> None:
    got, _ = record(quality=CameraQuality(latency_s=0.08))
    for _, reading in got:
        assert int(reading.image_bgr[0, 0, 0]) == pytest.approx(reading.t_s * 100, abs=1)


def test_a_reading_tells_nothing_of_the_scene() -> None:
    got, _ = record()
    reading = got[0][1]
    assert (reading.depth_m, reading.object_ids, reading.camera_pose) == (None, None, None)


def test_jitter_moves_deliveries_but_not_exposures_nor_their_order() -> None:
    quality = CameraQuality(latency_s=0.1, jitter_s=0.04, exposure_s=0.01)
    got, _ = record(5.0, quality)
    delays = np.array([arrived_s - reading.t_s for arrived_s, reading in got])
    assert 0.02 < delays.std() < 0.06
    assert delays.mean() == pytest.approx(0.1, abs=0.025)
    assert delays.min() >= 0.005 - 1e-9
    assert [reading.seq for _, reading in got] == sorted(reading.seq for _, reading in got)
    assert all(abs(reading.t_s * 20 - reading.seq) < 1e-9 for _, reading in got)


def test_a_seed_gives_the_same_images_and_another_gives_others() -> None:
    quality = CameraQuality(noise_std_dn=3.0, latency_s=0.05, jitter_s=0.01)
    (first, _), (same, _), (other, _) = (record(0.5, quality, seed) for seed in (1, 1, 2))
    assert len(first) == len(same)
    for (a_s, a), (b_s, b) in zip(first, same, strict=True):
        assert a_s == b_s
        assert np.array_equal(a.image_bgr, b.image_bgr)
    assert any(
        not np.array_equal(a.image_bgr, b.image_bgr)
        for (_, a), (_, b) in zip(first, other, strict=False)
    )


def test_without_a_pose_there_is_no_picture_and_its_number_is_left_out() -> None:
    history = PoseHistory(2.0)
    got: list[CameraReading] = []

    async def main() -> int:
        camera = RenderedCamera(
            source=FakeSource(),
            history=history,
            intrinsics=CAMERA,
            rate_hz=10.0,
            side="real",
            rng=np.random.default_rng(1),
        )
        loop = asyncio.get_running_loop()
        loop.call_at(0.35, history.add, 0.35, Pose((0.0, 0.0, 0.0)))
        running = asyncio.create_task(camera.run(got.append))
        await asyncio.sleep(1.05)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        return camera.left_out

    assert run_virtual(main()) == 8
    assert [reading.seq for reading in got] == [4, 5, 6]


def test_a_slow_renderer_costs_exposures_not_order() -> None:
    async def slow(job: Callable[[], T], /) -> T:
        await asyncio.sleep(0.12)
        return job()

    got, camera = record(1.0, compute=slow)
    assert [reading.seq for _, reading in got] == [0, 3, 6, 9, 12, 15]
    assert camera.left_out >= 10
    assert all(arrived_s >= reading.t_s + 0.12 - 1e-9 for arrived_s, reading in got)


def test_an_exception_of_the_receiver_ends_the_camera() -> None:
    async def main() -> None:
        history = PoseHistory(2.0)
        history.add(0.0, Pose((0.0, 0.0, 0.0)))
        camera = RenderedCamera(
            source=FakeSource(),
            history=history,
            intrinsics=CAMERA,
            rate_hz=10.0,
            side="twin",
            rng=np.random.default_rng(1),
        )

        def refuse(_: CameraReading) -> None:
            raise RuntimeError("receiver's own fault")

        with pytest.raises(ExceptionGroup) as caught:
            await camera.run(refuse)
        assert caught.group_contains(RuntimeError, match="own fault")

    run_virtual(main())


def test_an_asked_camera_answers_from_the_pose_it_is_given() -> None:
    async def main() -> None:
        source = FakeSource()
        mount = CameraMount(Pose((0.1, 0.0, 0.0)))
        camera = OnDemandCamera(source=source, intrinsics=CAMERA, mount=mount)
        body = Pose((1.0, 0.0, 0.0))
        plain = await camera.ask(body, 3.0)
        full = await camera.ask(body, 3.1, want_depth=True, want_ids=True)
        assert (plain.seq, plain.t_s, plain.source) == (0, 3.0, "twin")
        assert plain.depth_m is None
        assert full.seq == 1
        assert full.depth_m is not None
        assert full.object_ids is not None
        assert full.camera_pose == Pose((1.1, 0.0, 0.0))
        assert int(plain.image_bgr[0, 0, 0]) == 110
        assert source.asked[0] == (Pose((1.1, 0.0, 0.0)), 3.0)

    run_virtual(main())


def test_the_next_tick_follows_the_rate() -> None:
    assert [next_camera_tick(t_s, 10.0) for t_s in (0.0, 0.05, 0.1, 0.1000000001, 0.11)] == [
        0,
        1,
        1,
        1,
        2,
    ]


def test_a_profile_gives_the_camera_its_faults() -> None:
    cage = CameraQuality.of_profile(load_profile("cage").camera)
    assert cage.noise_std_dn > 0
    assert cage.latency_s > 0
    assert CameraQuality.of_profile(load_profile("nominal").camera) == CameraQuality()


def effects(quality: CameraQuality) -> CameraEffects:
    return CameraEffects(quality, CAMERA, np.random.default_rng(3))


def level(value: int) -> BgrImage:
    return np.full((48, 64, 3), value, np.uint8)


def test_a_perfect_camera_returns_the_picture_itself() -> None:
    image = level(90)
    taken = effects(CameraQuality()).apply(image, streak_px=NO_STREAK, noise_roll_px=(1, 2))
    assert taken is image


@pytest.mark.parametrize(("given", "seen"), [(100, 95), (0, 5), (255, 235), (254, 234)])
def test_exposure_is_a_gain_and_an_offset(given: int, seen: int) -> None:
    quality = CameraQuality(gain=0.9, offset_dn=5.0)
    taken = effects(quality).apply(level(given), streak_px=NO_STREAK, noise_roll_px=(0, 0))
    assert (taken == round(given * 0.9 + 5.0)).all()
    assert abs(int(taken[0, 0, 0]) - seen) <= 1


def test_exposure_saturates() -> None:
    bright = CameraQuality(gain=2.0, offset_dn=-20.0)
    made = effects(bright)
    assert (made.apply(level(200), streak_px=NO_STREAK, noise_roll_px=(0, 0)) == 255).all()
    assert (made.apply(level(5), streak_px=NO_STREAK, noise_roll_px=(0, 0)) == 0).all()


def test_noise_has_its_deviation_no_bias_and_saturates() -> None:
    made = effects(CameraQuality(noise_std_dn=4.0))
    image = level(120)
    noise = made.apply(image, streak_px=NO_STREAK, noise_roll_px=(0, 0)).astype(float) - 120
    assert noise.std() == pytest.approx(4.0, rel=0.05)
    assert abs(noise.mean()) < 0.15
    assert (image == 120).all()
    black = made.apply(level(0), streak_px=NO_STREAK, noise_roll_px=(0, 0))
    white = made.apply(level(255), streak_px=NO_STREAK, noise_roll_px=(0, 0))
    assert black.max() < 30
    assert white.min() > 225


def test_noise_is_another_one_when_it_is_rolled() -> None:
    made = effects(CameraQuality(noise_std_dn=4.0))
    a, b = (
        made.apply(level(120), streak_px=NO_STREAK, noise_roll_px=roll).astype(float) - 120
        for roll in ((0, 0), (17, 90))
    )
    assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.05


def test_blur_smears_along_the_streak_and_keeps_the_light() -> None:
    image = level(0)
    image[20:24, 30:34] = 200
    wide = blur_image(image, (8.0, 0.0))
    assert wide.sum(dtype=int) == pytest.approx(image.sum(dtype=int), rel=0.03)
    assert np.flatnonzero(wide[:, :, 0].any(axis=1)).tolist() == [20, 21, 22, 23]
    columns = np.flatnonzero(wide[:, :, 0].any(axis=0))
    assert (columns[0], columns[-1]) == (26, 37)
    tall = blur_image(image, (0.0, 8.0))
    rows = np.asarray(wide[20:24].any(axis=(0, 2)))[10:58]
    assert np.array_equal(np.asarray(tall[:, 30:34].any(axis=(1, 2))), rows)
    assert blur_image(image, (0.9, 0.3)) is image
    assert blur_image(image, (500.0, 0.0)).shape == image.shape
    assert blur_image(image, (math.nan, 0.0)) is image


def test_the_streak_is_how_far_the_picture_moves() -> None:
    start = Pose((0.0, 0.0, 0.0))
    focal = CAMERA.fx_px
    right = Pose((0.0, 0.03, 0.0))
    assert motion_streak_px(start, right, CAMERA) == pytest.approx((-focal * 0.01, 0.0))
    turned = Pose((0.0, 0.0, 0.0), quat_from_euler(0.0, 0.0, 0.02))
    assert motion_streak_px(start, turned, CAMERA) == pytest.approx((-focal * math.tan(0.02), 0.0))
    nose_up = Pose((0.0, 0.0, 0.0), quat_from_euler(0.0, 0.02, 0.0))
    assert motion_streak_px(start, nose_up, CAMERA) == pytest.approx((0.0, focal * math.tan(0.02)))
    behind = Pose((0.0, 0.0, 0.0), quat_from_euler(0.0, 0.0, math.pi))
    assert motion_streak_px(start, behind, CAMERA) == NO_STREAK


def test_a_turning_camera_blurs_and_a_still_one_does_not() -> None:
    """The streak of an exposure follows from the poses at both of its ends."""

    class Edge(FakeSource):
        def picture(self, *given: Any, **more: Any) -> FakePicture:
            image = level(0)
            image[:, 32:] = 200
            return FakePicture(image)

    def widest_edge(yaw_rate_rad_s: float) -> int:
        got: list[CameraReading] = []

        async def main() -> None:
            history = PoseHistory(2.0)
            for step in range(100):
                yaw = quat_from_euler(0.0, 0.0, yaw_rate_rad_s * step * 0.004)
                history.add(step * 0.004 - 0.1, Pose((0.0, 0.0, 0.0), yaw))
            camera = RenderedCamera(
                source=Edge(),
                history=history,
                intrinsics=CAMERA,
                rate_hz=10.0,
                side="real",
                rng=np.random.default_rng(1),
                quality=CameraQuality(exposure_s=0.04),
            )
            running = asyncio.create_task(camera.run(got.append))
            await asyncio.sleep(0.05)
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

        run_virtual(main())
        row = got[0].image_bgr[0, :, 0]
        return int(((row > 0) & (row < 200)).sum())

    assert widest_edge(0.0) == 0
    assert widest_edge(4.0) >= 6
