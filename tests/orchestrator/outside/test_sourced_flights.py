"""Whole flights whose real camera is a recording: on the virtual clock, like any other."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from orchestrator.results import RunResult
from tests.orchestrator.flights import all_landed

Fly = Callable[..., tuple[RunResult, Path]]

HZ = 15
SIZE = (320, 240)


def film(path: Path, seconds: float) -> Path:
    """A grey wall, filmed."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), HZ, SIZE)
    wall = np.random.default_rng(1).normal(140, 20, (6, 8))
    shown = cv2.resize(wall, SIZE).clip(0, 255).astype(np.uint8)
    for _ in range(round(seconds * HZ)):
        writer.write(cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def source(path: Path) -> tuple[str, ...]:
    return (f"vehicles.real.sensors.camera.source={path}",)


def test_a_film_of_a_wall_and_the_gate_that_is_not_there(fly_run: Fly, tmp_path: Path) -> None:
    result, folder = fly_run(sets=source(film(tmp_path / "wall.mp4", 90.0)))
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.outside is not None
    (one,) = result.outside.sources
    assert (one.vehicle, one.sensor, one.source) == ("real", "camera", "file")
    assert one.delivered > 200
    assert result.mixing is not None
    assert result.mixing.frames > 100
    assert all_landed(folder)


@pytest.mark.parametrize("ending", ["is over", "changes its size"])
def test_a_recording_that_fails_in_flight_is_an_error_and_lands(
    fly_run: Fly, tmp_path: Path, ending: str
) -> None:
    if ending == "is over":
        given, said = film(tmp_path / "short.mp4", 12.0), "the recording is over"
    else:
        given, said = tmp_path / "images", "160x120 came"
        given.mkdir()
        for k in range(12 * HZ):
            size = SIZE if k < 11 * HZ else (160, 120)
            cv2.imwrite(str(given / f"{k}.png"), np.full((size[1], size[0], 3), 90, np.uint8))
    result, folder = fly_run(sets=source(given))
    assert result.verdict == "ERROR"
    assert said in result.reason
    assert all_landed(folder)
