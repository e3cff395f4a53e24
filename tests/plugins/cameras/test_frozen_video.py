"""A camera that is frozen before its encoder: no two images are equal, and all show the same."""

import io
import math
from collections.abc import Iterator
from itertools import groupby
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from wil_campaign.vehicles.readings import CameraReading, DepthReading
from wil_campaign.vehicles.sources.readings.frozen_readings import FrozenReadings
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

Picture = NDArray[np.uint8]
SIZE = (320, 240)
LENS = Intrinsics.from_fov(*SIZE, 1.2)


def scene() -> Picture:
    """A room with furniture, by a noisy camera."""
    rng = np.random.default_rng(1)
    image = cv2.resize(rng.normal(128.0, 25.0, (6, 8, 3)), SIZE, interpolation=cv2.INTER_CUBIC)
    for _ in range(20):
        x, y, width, height = (int(one) for one in rng.integers((0, 0, 8, 8), (300, 220, 80, 80)))
        colour = [float(one) for one in rng.integers(0, 255, 3)]
        cv2.rectangle(image, (x, y), (x + width, y + height), colour, -1)
    return noisy(image, rng)


def noisy(image: Any, rng: np.random.Generator, sigma: float = 2.5) -> Picture:
    noise = rng.normal(0.0, sigma, image.shape)
    return np.asarray((image + noise).clip(0, 255), np.uint8)


def streamed(pictures: list[Picture], **options: str) -> Iterator[Picture]:
    """Yield pictures as they arrive through H.264."""
    file = io.BytesIO()
    with av.open(file, "w", format="mpegts") as container:
        stream: Any = container.add_stream("libx264", rate=15)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        stream.options = {"tune": "zerolatency", "g": "15", **options}
        for picture in pictures:
            yuv = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(yuv, format="yuv420p")))
        container.mux(stream.encode(None))
    file.seek(0)
    with av.open(file) as video:
        for frame in video.decode(video=0):
            yield frame.to_ndarray(format="bgr24")


def watched(pictures: list[Picture], *, step_m: float = 0.05, step_rad: float = 0.0) -> list[str]:
    """Return what is said of images while the vehicle moves and turns."""
    frozen, said = FrozenReadings(), []
    for k, image in enumerate(pictures):
        pose = Pose.of(step_m * k, 0.0, 1.0, yaw_rad=step_rad * k)
        reading = CameraReading(k / 15, k / 15, k, "real", image, LENS, rendered=False)
        if text := frozen.receive(reading, pose):
            said.append(text)
    return said


@pytest.mark.parametrize(
    "encoder",
    [
        {"preset": "ultrafast", "crf": "23"},
        {"preset": "veryfast", "crf": "28"},
        {"preset": "veryfast", "b": "300k"},
    ],
)
@pytest.mark.parametrize(("step_m", "step_rad"), [(0.05, 0.0), (0.001, math.radians(1.0))])
def test_a_still_behind_an_encoder_is_frozen(
    encoder: dict[str, str], step_m: float, step_rad: float
) -> None:
    images = list(streamed([scene()] * 60, **encoder))[15:]
    longest = max(len(list(alike)) for _, alike in groupby(images, lambda one: one.tobytes()))
    assert longest < 10, "it is not found by equal images"
    said = watched(images, step_m=step_m, step_rad=step_rad)
    assert said
    assert " images, in " in said[0]
    assert said[0].endswith("the sensor is frozen")
    assert not watched(images, step_m=0.01)


def clocked(image: Picture, k: int, *, row: int) -> Picture:
    """Return an image with the time in milliseconds laid over it, as cameras of halls do."""
    shown, text = image.copy(), f"2026-12-02 03:08:{k / 15:06.3f}"
    cv2.rectangle(shown, (4, row - 14), (220, row + 4), (0.0, 0.0, 0.0), -1)
    cv2.putText(shown, text, (6, row), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255.0, 255.0, 255.0), 1)
    return shown


@pytest.mark.parametrize("row", [16, 234])
@pytest.mark.parametrize("is_encoded", [True, False])
def test_a_still_under_a_running_clock_is_frozen(row: int, is_encoded: bool) -> None:
    """Each image differs by the digits of the time, and was taken for one that sees: PASS."""
    images = [clocked(scene(), k, row=row) for k in range(60)]
    if is_encoded:
        images = list(streamed(images, preset="veryfast", crf="28"))[15:]
    said = watched(images)
    assert said
    assert said[0].endswith("the sensor is frozen")
    assert not watched(images, step_m=0.01)


def test_a_wall_between_edges_that_pass_by_is_no_clock() -> None:
    """Where nothing can be told apart beside the edges, these alone say that a camera sees."""
    rng, wall = np.random.default_rng(2), np.full((SIZE[1], SIZE[0], 3), 120.0)
    tiles = np.where(np.arange(2 * SIZE[0]) // 40 % 2 == 0, 20.0, 220.0)
    images = []
    for k in range(60):
        wall[:40] = wall[-40:] = tiles[3 * k : 3 * k + SIZE[0], np.newaxis]
        images.append(noisy(wall, rng))
    assert not watched(images)
    wall[-40:] = 120.0
    wall[100:140, :160] = 20.0
    assert not watched(
        [noisy(np.vstack((np.roll(wall[:40], 4 * k, 1), wall[40:])), rng) for k in range(60)]
    )


def test_a_camera_that_sees_is_not_frozen() -> None:
    rng, image = np.random.default_rng(2), scene().astype(np.float64)
    row, column = SIZE[1] / 2, SIZE[0] / 2
    # 0.05 m nearer each time, to a scene that is 60 m away.
    ahead = [
        cv2.getRotationMatrix2D((column, row), 0.0, 60.0 / (60.0 - 0.05 * k)) for k in range(60)
    ]
    assert not watched([noisy(cv2.warpAffine(image, one, SIZE), rng) for one in ahead])
    wall = np.full_like(image, 120.0)
    assert not watched([noisy(wall, rng) for _ in range(60)]), "nothing to see"
    wall[:20] = wall[-20:] = 0.0
    assert not watched([noisy(wall, rng) for _ in range(60)]), "bars above and below"


@pytest.mark.parametrize(("level", "word"), [(2.0, "black"), (255.0, "white")])
def test_a_camera_that_is_covered_or_dazzled_shows_nothing(level: float, word: str) -> None:
    """Its noise alone made no two images equal: a gate was drawn into black, and passed."""
    rng, image = np.random.default_rng(3), np.full((SIZE[1], SIZE[0], 3), level)
    blank = [noisy(image, rng) for _ in range(60)]
    said = watched(blank)
    assert f"its images were {word} all over for 1.00 s" in said[0]
    assert len(said) == 45, "from a second on"
    assert not watched(blank, step_m=0.005), "on the ground, or at one place"
    sees = noisy(scene(), rng)
    assert not watched([sees if k % 14 == 0 else one for k, one in enumerate(blank)])
    dark = image.copy()
    dark[100:140, 100:140] = 128.0
    assert not watched([noisy(dark, rng) for _ in range(60)]), "a lamp at night"


def covered_depth(rng: np.random.Generator, *, seen: float = 0.6) -> Any:
    """Return the noise of a time-of-flight camera behind tape: centimetres, and holes."""
    depth_m = rng.normal(0.06, 0.01, (SIZE[1], SIZE[0])).astype(np.float32)
    depth_m[rng.random(depth_m.shape) > seen] = np.inf
    return depth_m


@pytest.mark.parametrize(
    ("seen", "farthest_m", "is_said"),
    [(0.6, 0.06, True), (1.0, 0.06, True), (0.02, 0.06, False), (0.6, 0.5, False)],
)
def test_a_depth_camera_that_is_covered_shows_centimetres(
    seen: float, farthest_m: float, is_said: bool
) -> None:
    """Its noise made no two images equal: what stands before the vehicle was not there, PASS."""
    rng, frozen, said = np.random.default_rng(4), FrozenReadings(), []
    for k in range(60):
        depth_m = covered_depth(rng, seen=seen)
        depth_m[100:140, 100:140] = farthest_m
        reading = DepthReading(k / 15, k / 15, k, "real", depth_m, LENS, rendered=False)
        said.append(frozen.receive(reading, Pose.of(0.05 * k, 0.0, 1.0)))
    assert any(said) == is_said
    if is_said:
        assert said[15] == (
            "its images were within 0.15 m all over for 1.00 s: the camera is covered, dazzled or "
            "broken"
        )
