"""Recordings to test with: a camera, a recorder, a run of two seconds."""

import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from wil_campaign.orchestrator.recording.mcap.mcap_settings import LOSSLESS, RecordingSettings
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder, RecordingReport
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.plugins.python.mcap_reader import (
    Recorded,
    RecordedEvent,
    RecordedProvenance,
    RecordedReading,
    Recording,
)
from wil_campaign.recipes.pipeline.mixture import Provenance, StageTime
from wil_campaign.vehicles.readings import CameraReading, PoseReading, Reading, Source
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

NAN, INF = math.nan, math.inf
RNG = np.random.default_rng(5)
INTRINSICS = Intrinsics(64, 48, 50.5, 51.25, 31.5, 23.5, (0.1, -0.02, 0.0, 0.001, 0.0))
MOUNT = Pose.of(0.1, 0.0, -0.05, pitch_rad=-0.3)
PROVENANCE = Provenance(
    real_seq=4,
    real_t_s=1.0 / 3.0,
    twin_seq=None,
    twin_t_s=None,
    skew_ms=None,
    latency_ms=12.5,
    alignment="interpolated",
    stages=(StageTime("resize", 0.001), StageTime("overlay", 0.002)),
)


def camera(k: int = 0, source: Source = "real") -> CameraReading:
    depth = RNG.uniform(1.0, 5.0, (48, 64)).astype(np.float32)
    depth[:4] = INF
    return CameraReading(
        t_s=k / 15.0,
        arrived_s=k / 15.0 + 0.06,
        seq=k,
        source=source,
        image_bgr=RNG.integers(0, 255, (48, 64, 3), np.uint8),
        intrinsics=INTRINSICS,
        depth_m=depth,
        object_ids=RNG.integers(0, 3, (48, 64), np.uint8),
        camera_pose=MOUNT,
        rendered=source == "twin",
    )


def recorder(path: Path, **changes: Any) -> McapRecorder:
    arguments: dict[str, Any] = {
        "epoch_s": VIRTUAL_EPOCH_S,
        "clock": "virtual",
        "settings": LOSSLESS,
    } | changes
    return McapRecorder(path=path, **arguments)


def read(path: Path) -> tuple[list[Recorded], Recording]:
    recording = Recording(path)
    return list(recording), recording


def same(a: Any, b: Any) -> bool:
    """Equal to the bit, NaN included."""
    if isinstance(a, np.ndarray):
        return (
            isinstance(b, np.ndarray)
            and a.dtype == b.dtype
            and a.shape == b.shape
            and (a.tobytes() == b.tobytes())
        )
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and repr(a) == repr(b)


def assert_same(a: Reading, b: Reading) -> None:
    assert type(a) is type(b)
    for field in fields(a):
        assert same(getattr(a, field.name), getattr(b, field.name)), field.name


def a_run(path: Path, **changes: Any) -> RecordingReport:
    """Record two seconds: pictures of three sources, a scan, poses, and log lines."""
    generator = np.random.default_rng(1)
    with recorder(path, **changes) as run:
        for k in range(30):
            t_s = k / 15.0
            for source in ("real", "twin"):
                image = generator.integers(0, 255, (48, 64, 3), np.uint8)
                picture = replace(camera(k, source), image_bgr=image, depth_m=None)
                run.reading("camera", replace(picture, object_ids=None))
            run.mixed("camera", None, replace(PROVENANCE, real_seq=k), now_s=t_s + 0.07)
            pose = Pose.of(0.1 * k, 0.0, 1.0)
            run.reading("mocap", PoseReading(t_s, t_s + 0.01, "real", pose, seq=k))
        run.event(3.0, "info", "stage", "landed")
        return run.close()


SMALL_CHUNKS = RecordingSettings(chunk_bytes=20_000)


def key(one: Recorded) -> tuple[object, ...]:
    match one:
        case RecordedReading(sensor, reading, _):
            return (sensor, reading.source, reading.seq, reading.t_s)
        case RecordedProvenance(sensor, log_ns, values):
            return (sensor, log_ns, values["real_seq"])
        case RecordedEvent(log_ns, level, name, message):
            return (log_ns, level, name, message)
