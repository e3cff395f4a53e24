"""Whole flights whose real camera is recorded or live: on the virtual clock, like any other."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, Self

import cv2
import numpy as np
import pytest

from tests.orchestrator.conftest import SMALL_CAMERAS
from tests.orchestrator.flights import all_landed, log_of
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.python.mcap_reader import RecordedReading, Recording
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.sources.camera_source import (
    SourceCounts,
    SourceError,
    SourceStalledError,
)

Fly = Callable[..., tuple[RunResult, Path]]

HZ = 15
SIZE = (160, 120)


def film(path: Path, seconds: float) -> Path:
    """A grey wall, filmed."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), HZ, SIZE)
    wall = np.random.default_rng(1).normal(140, 20, (6, 8))
    shown = cv2.resize(wall, SIZE).clip(0, 255).astype(np.uint8)
    for _ in range(round(seconds * HZ)):
        writer.write(cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def source(path: Path | str) -> tuple[str, ...]:
    pictures = (
        f"vehicles.{name}.sensors.camera.{key}={size_px}"
        for name in ("real", "twin")
        for key, size_px in zip(("width_px", "height_px"), SIZE, strict=True)
    )
    return (*pictures, f"vehicles.real.sensors.camera.source={path}")


def test_a_film_of_a_wall_and_the_gate_that_is_not_there(fly_run: Fly, tmp_path: Path) -> None:
    result, folder = fly_run(cameras=SMALL_CAMERAS, sets=source(film(tmp_path / "wall.mp4", 40.0)))
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.outside is not None
    (one,) = result.outside.sources
    assert (one.vehicle, one.sensor, one.source) == ("real", "camera", "file")
    assert one.delivered > 200
    assert result.mixing is not None
    assert result.mixing.frames > 100
    assert all_landed(folder)
    # What we draw ends with the goal; the camera goes on, and is recorded until the end.
    (ended,) = [line for line in log_of(folder) if line["event"] == "images_ended"]
    assert ended["topics"] == "/mixed/camera /twin/camera"
    last_s = {
        item.reading.source: item.reading.arrived_s
        for item in Recording(folder / "run.mcap")
        if isinstance(item, RecordedReading)
    }
    assert ended["t_s"] - 0.2 < last_s["mixed"] <= ended["t_s"]
    assert last_s["real"] > ended["t_s"] + 2.0


@pytest.mark.parametrize("ending", ["is over", "changes its size"])
def test_a_recording_that_fails_in_flight_is_an_error_and_lands(
    fly_run: Fly, tmp_path: Path, ending: str
) -> None:
    if ending == "is over":
        given, said = film(tmp_path / "short.mp4", 6.0), "the recording is over"
    else:
        given, said = tmp_path / "images", "images are 80x60"
        given.mkdir()
        for k in range(6 * HZ):
            size = SIZE if k < 5 * HZ else (80, 60)
            cv2.imwrite(str(given / f"{k}.png"), np.full((size[1], size[0], 3), 90, np.uint8))
    result, folder = fly_run(cameras=SMALL_CAMERAS, sets=source(given))
    assert result.verdict == "ERROR"
    assert said in result.reason
    assert all_landed(folder)


class FakeLive:
    """A live camera that takes grey pictures with noise, until it fails or repeats the last one."""

    kind: Literal["live"] = "live"

    def __init__(
        self, intrinsics: Any, after_s: float, error: SourceError | None = None, *, freezes: bool
    ) -> None:
        self.name = "rtp://127.0.0.1:5600"
        self.intrinsics = intrinsics
        self.counts = SourceCounts()
        self._error: SourceError | None = error
        self._after_s = after_s
        self._freezes = freezes
        self._rng = np.random.default_rng(1)
        self._picture = self._taken()
        self._seq = 0

    def _taken(self) -> Any:
        size = (self.intrinsics.height_px, self.intrinsics.width_px, 3)
        return self._rng.normal(110.0, 2.0, size).astype(np.uint8)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        pass

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> CameraReading:
        await asyncio.sleep(1.0 / HZ)
        now_s = asyncio.get_running_loop().time()
        if self._error is not None and now_s > self._after_s:
            error, self._error = self._error, None
            if isinstance(error, SourceStalledError):
                await asyncio.sleep(2.0)
            raise error
        self._seq += 1
        if not self._freezes or now_s < self._after_s:
            self._picture = self._taken()
        picture = self._picture.copy()
        return CameraReading(
            now_s - 0.05, now_s, self._seq, "real", picture, self.intrinsics, rendered=False
        )


@pytest.mark.parametrize(
    ("error", "verdict"),
    [
        (SourceStalledError("no picture for 2 s after 300 pictures"), "INVALID"),
        (SourceError("the camera is gone"), "ERROR"),
    ],
)
def test_a_live_camera_that_stalls_or_dies_in_flight(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, error: SourceError, verdict: str
) -> None:
    def opened(address: str, *, intrinsics: Any, **_: Any) -> FakeLive:
        assert address == "rtp://127.0.0.1:5600"
        return FakeLive(intrinsics, 12.0, error, freezes=False)

    monkeypatch.setattr("wil_campaign.plugins.cameras.camera_factory.live_camera", opened)
    result, folder = fly_run(cameras=SMALL_CAMERAS, sets=source("rtp://127.0.0.1:5600"))
    assert result.verdict == verdict
    assert all_landed(folder)
    assert result.outside is not None
    assert result.outside.sources[0].source == "live"
    assert str(error) in result.outside.sources[0].trouble
    if verdict == "ERROR":
        assert str(error) in result.reason


def test_a_live_camera_that_dies_before_arming_keeps_the_vehicles_on_the_ground(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(_: str, *, intrinsics: Any, **__: Any) -> FakeLive:
        return FakeLive(intrinsics, 0.5, SourceStalledError("it is dark"), freezes=False)

    monkeypatch.setattr("wil_campaign.plugins.cameras.camera_factory.live_camera", opened)
    result, folder = fly_run(cameras=SMALL_CAMERAS, sets=source("rtp://127.0.0.1:5600"))
    assert (result.verdict, result.reason) == ("ERROR", "it is dark")
    assert "takeoff" not in [line["stage"] for line in log_of(folder) if line["event"] == "stage"]


@pytest.mark.parametrize("freezes", [True, False])
def test_a_live_camera_that_repeats_its_last_image_with_new_stamps_proves_nothing(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, freezes: bool
) -> None:
    def opened(_: str, *, intrinsics: Any, **__: Any) -> FakeLive:
        return FakeLive(intrinsics, 12.0, freezes=freezes)

    monkeypatch.setattr("wil_campaign.plugins.cameras.camera_factory.live_camera", opened)
    result, folder = fly_run(cameras=SMALL_CAMERAS, sets=source("rtp://127.0.0.1:5600"))
    assert all_landed(folder)
    assert result.outside is not None
    (camera,) = result.outside.sources
    if not freezes:
        assert (result.verdict, result.reason, camera.stalls) == ("PASS", "", 0)
        return
    assert result.verdict == "INVALID"
    assert result.reason.startswith("real camera: its last ")
    assert result.reason.endswith("meanwhile: the sensor is frozen")
    assert camera.stalls == 1
