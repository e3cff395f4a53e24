"""A recording as a source: everything once, in order, when it was due."""

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.mcap_runs import a_run, assert_same, camera, recorder
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.recording.mcap.mcap_settings import RecordingSettings
from wil_campaign.plugins.python.replay_source import ReplaySource
from wil_campaign.vehicles.readings import PoseReading, Source
from wil_campaign.worlds.frames import Pose


@pytest.fixture
def path(tmp_path: Path) -> Path:
    a_run(tmp_path / "run.mcap")
    return tmp_path / "run.mcap"


def test_taking_in_steps_gives_everything_once_and_on_time(path: Path) -> None:
    source = ReplaySource(path)
    found = []
    for k in range(1, 60):
        now_s = 0.04 * k
        for sensor, reading in source.take(now_s):
            # poses were handed over behind the pictures of their moment, which came later
            assert reading.arrived_s <= now_s
            found.append((sensor, reading.source, reading.seq))
    assert source.next_due_s is None
    assert source.take(99.0) == []
    assert sorted(found) == sorted(
        [("camera", s, k) for k in range(30) for s in ("real", "twin")]
        + [("mocap", "real", k) for k in range(30)]
    )


def test_a_replay_gives_the_wanted_sensors_and_sources_alone(path: Path) -> None:
    poses = ReplaySource(path, sensors={"mocap"}).take(99.0)
    assert [reading.seq for _, reading in poses] == list(range(30))
    only: tuple[Source, ...] = ("twin",)
    twins = ReplaySource(path, sources=only).take(99.0)
    assert {reading.source for _, reading in twins} == {"twin"}


def test_readings_arrive_on_the_run_clock(path: Path) -> None:
    async def replay() -> list[tuple[float, float]]:
        loop = asyncio.get_running_loop()
        source = ReplaySource(path, sensors={"camera"}, offset_s=2.0)
        return [(loop.time(), reading.arrived_s) async for _, reading in source]

    times = run_virtual(replay())
    assert len(times) == 60
    assert [now_s for now_s, _ in times] == pytest.approx([due_s + 2.0 for _, due_s in times])


def test_a_replay_that_would_diverge_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with recorder(path, settings=RecordingSettings()) as run:
        run.reading("mocap", PoseReading(0.0, 0.0, "real", Pose((0.0, 0.0, 0.0))))
        run.reading("camera", camera())
    assert len(ReplaySource(path).take(9.0)) == 2
    with pytest.raises(ValueError, match="camera are JPEG"):
        ReplaySource(path, exact_only=True).take(9.0)


def test_a_file_can_be_replayed_into_a_recording_of_equal_readings(
    path: Path, tmp_path: Path
) -> None:
    with recorder(tmp_path / "again.mcap") as run:
        for sensor, reading in ReplaySource(path).take(99.0):
            run.reading(sensor, replace(reading))
    once, again = (ReplaySource(p).take(99.0) for p in (path, tmp_path / "again.mcap"))
    assert len(once) == len(again) == 90
    for (_, a), (_, b) in zip(once, again, strict=True):
        assert_same(a, b)
