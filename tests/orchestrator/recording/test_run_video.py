"""The video of a recorded run: made of run.mcap at any time, and whole or not at all."""

import json
from pathlib import Path

import av
import numpy as np
import pytest
from mcap.writer import Writer

from tests.orchestrator.report.recorded_campaign import INTRINSICS
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap.mcap_encode import PERCEIVED
from wil_campaign.orchestrator.recording.mcap.mcap_settings import ImageSettings, RecordingSettings
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder
from wil_campaign.orchestrator.recording.run_video import make_video
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.vehicles.readings import CameraReading, Source

ALL: tuple[tuple[Source, str, int], ...] = (
    ("twin", "front", 40),
    ("real", "front", 80),
    ("real", "down", 120),
    ("mixed", "front", 200),
)
"""Source, camera and grey value."""


def record(
    folder: Path, *, perceived: str | None, mode: str = "wil", count: int = 20, form: str = "jpeg"
) -> Path:
    """Record images of all cameras, ten a second; perceived: the topic that is named, if any."""
    images = ImageSettings(form)  # type: ignore[arg-type]  # a name in a test
    with McapRecorder(
        path=folder / "run.mcap",
        epoch_s=VIRTUAL_EPOCH_S,
        clock="virtual",
        settings=RecordingSettings(real=images, twin=images, mixed=images, chunk_bytes=4000),
        facts={"mode": mode},
    ) as recorder:
        for k in range(count):
            for source, sensor, grey in ALL:
                image = np.full((48, 64, 3), grey, np.uint8)
                t_s = 1.0 + k / 10
                recorder.reading(
                    sensor, CameraReading(t_s, t_s + 0.05, k, source, image, INTRINSICS)
                )
            if k == 0 and perceived is not None:
                recorder.event(1.05, "info", PERCEIVED, perceived)
    return folder


def frames(folder: Path) -> list[tuple[float, int]]:
    """Return time, from the first on, and grey of each frame of the made video."""
    with av.open(str(folder / "mixed.mp4")) as video:
        return [
            (round(float(one.time or 0.0), 3), round(float(one.to_ndarray(format="gray").mean())))
            for one in video.decode(video=0)
        ]


@pytest.mark.parametrize(
    ("perceived", "mode", "grey"),
    [
        ("/real/down", "wil", 120),
        ("/mixed/front", "wil", 200),
        # A recording from before the line: the first camera of what the mode perceives.
        (None, "wil", 200),
        (None, "sim", 40),
        (None, "real", 80),
    ],
)
def test_a_video_shows_what_was_perceived_at_its_times(
    tmp_path: Path, perceived: str | None, mode: str, grey: int
) -> None:
    seen: list[float] = []
    assert make_video(record(tmp_path, perceived=perceived, mode=mode), passed=seen.append)
    found = frames(tmp_path)
    assert [t_s for t_s, _ in found] == pytest.approx([k / 10 for k in range(20)], abs=1e-3)
    assert seen == pytest.approx([1.0 + k / 10 for k in range(20)])
    assert all(abs(shown - grey) < 4 for _, shown in found)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mixed.mp4", "run.mcap"]


@pytest.mark.parametrize("perceived", ["/mixed/front", None])
def test_a_recording_without_images_has_no_video(tmp_path: Path, perceived: str | None) -> None:
    assert not make_video(record(tmp_path, perceived=perceived, form="none"))
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_a_cut_recording_gives_the_video_up_to_the_cut(tmp_path: Path) -> None:
    whole = (record(tmp_path, perceived="/mixed/front", count=60) / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(whole[: len(whole) // 2])
    assert make_video(tmp_path)
    assert 10 < len(frames(tmp_path)) < 50


def test_a_video_that_cannot_be_made_leaves_the_one_that_is_there(tmp_path: Path) -> None:
    (tmp_path / "mixed.mp4").write_bytes(b"as it was")
    with pytest.raises(OSError, match="No such file"):
        make_video(tmp_path)
    (tmp_path / "run.mcap").write_bytes(b"no recording")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        make_video(tmp_path)
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        facts = {"source": "mixed", "sensor": "front", "part": "reading"}
        channel = writer.register_channel("/mixed/front", "json", 0, facts)
        for data in ({"type": "camera"}, {"type": "camera", "t_s": "soon"}):
            document = json.dumps({"wil": data}).encode()
            writer.add_message(channel, log_time=0, publish_time=0, data=document)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped
    with pytest.raises(RecordingError, match="no video can be made of it: KeyError"):
        make_video(tmp_path)
    assert (tmp_path / "mixed.mp4").read_bytes() == b"as it was"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mixed.mp4", "run.mcap"]
