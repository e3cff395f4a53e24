"""Images that are not in a recording: drawn again to the bit, or refused with the reason."""

import asyncio
import json
import math
import tracemalloc
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.orchestrator.conftest import SMALL_CAMERAS, STEP
from tests.orchestrator.mcap_runs import assert_same, recorder
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.installation import flown_program
from wil_campaign.orchestrator.recording.mcap.mcap_bodies import drawing_body
from wil_campaign.orchestrator.recording.mcap.mcap_settings import (
    EXACT,
    RecordingSettings,
)
from wil_campaign.orchestrator.recording.recorded_images import NotDrawnAgainError, RecordedImages
from wil_campaign.orchestrator.recording.recorded_images import _drawer as drawers
from wil_campaign.orchestrator.recording.recording_facts import scene_digest, world_in
from wil_campaign.orchestrator.recording.run_video import make_video
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.python.mcap_reader import RecordedReading, Recording
from wil_campaign.vehicles.cameras.rendered_cameras import (
    CameraQuality,
    OnDemandCamera,
    RenderedCamera,
)
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import CameraReading, Reading, Source
from wil_campaign.vehicles.sensors.drawn_again import ImageRedrawer
from wil_campaign.vehicles.sensors.lens import ThroughLens
from wil_campaign.vehicles.sensors.world_views import WorldImages
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

WORLD = """{
  "schema": "wil/world/1",
  "origin": {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 488.0},
  "objects": {
    "wall": {
      "shape": {"box": {"size_m": [0.3, 4, 3]}},
      "pose": {"north_m": 6, "east_m": 0, "up_m": 1.5},
      "color": "blue"
    },
    "walker": {
      "shape": "person",
      "pose": {"north_m": 3, "east_m": -1, "up_m": 0},
      "motion": {
        "start": {"on": "goal", "delay_s": 0.2},
        "waypoints": [{"north_m": 3, "east_m": 1, "up_m": 0, "speed_m_s": 1.3, "yaw_deg": 70}]
      }
    }
  }
}"""
OTHER = WORLD.replace("4, 3]", "4, 2.9]")
EMPTY = WORLD[: WORLD.index('"walker"')].rstrip(", \n") + "}}"
FACTS = {"world": WORLD, "world_file": "world.yaml", "mode": "wil"}
BARREL = replace(Intrinsics.from_fov(160, 120, 1.2), distortion=(-0.28, 0.07, 0.0008, -0.0005, 0.0))
SHAKY = CameraQuality(3.0, 0.9, 4.0, exposure_s=0.04, latency_s=0.05, jitter_s=0.004)
NEEDED = replace(EXACT, keeps_drawn=False)


def drawn(quality: CameraQuality = SHAKY, side: Source = "twin") -> list[CameraReading]:
    """Return a second of images through lens and effects: camera and a person move."""
    got: list[CameraReading] = []

    async def fly() -> None:
        loop, history = asyncio.get_running_loop(), PoseHistory(2.0)
        world = world_in(FACTS)
        assert world is not None
        scene = world.scene(*(("real", "W") if side == "real" else ("wil", "Wv")))
        camera = RenderedCamera(
            source=ThroughLens(WorldImages(scene=scene, events={"goal": 0.3})),
            history=history,
            intrinsics=BARREL,
            rate_hz=10.0,
            side=side,
            rng=np.random.default_rng([2**70 + 1, 7]),
            quality=quality,
        )
        running = asyncio.create_task(camera.run(got.append))
        for _ in range(250):
            t_s = loop.time()
            pose = Pose.of(0.3 * t_s, 0.1, 1.0, yaw_rad=np.sin(5 * t_s) / 2, roll_rad=0.1)
            history.add(t_s, pose, (0.3, 0.0, 0.0))
            await asyncio.sleep(0.004)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    run_virtual(fly())
    return got


def recorded(
    path: Path, readings: list[CameraReading], facts: Mapping[str, str] = FACTS
) -> Recording:
    settings = RecordingSettings(real=NEEDED, twin=NEEDED, mixed=NEEDED)
    with recorder(path, settings=settings, facts=facts) as run:
        for reading in readings:
            run.reading("camera", reading)
    return Recording(path)


def images(recording: Recording) -> list[Reading]:
    return [one.reading for one in recording if isinstance(one, RecordedReading)]


def test_an_image_through_lens_and_effects_is_drawn_again_to_the_bit(tmp_path: Path) -> None:
    flown = drawn()
    again = images(recorded(tmp_path / "run.mcap", flown))
    assert len(again) == len(flown) == 10
    for before, after in zip(flown, again, strict=True):
        assert isinstance(after, CameraReading)
        assert before.image_bgr is not after.image_bgr
        assert_same(before, after)
    effects = [one.drawing.effects for one in flown if one.drawing is not None]
    assert any(one is not None and max(map(abs, one.streak_px)) > 1.0 for one in effects)
    assert len({one.drawing.moving for one in flown if one.drawing is not None}) > 3
    assert (tmp_path / "run.mcap").stat().st_size < 20_000


def test_depth_and_ids_of_an_image_on_request_are_drawn_again(tmp_path: Path) -> None:
    world = world_in(FACTS)
    assert world is not None
    source = ThroughLens(WorldImages(scene=world.scene("wil", "Wv"), events={"goal": 0.3}))
    camera = OnDemandCamera(source=source, intrinsics=BARREL)
    asked = camera.ask(Pose.of(0.5, 0.1, 1.0), 0.9, want_depth=True, want_ids=True)
    flown = run_virtual(asked)
    assert flown.depth_m is not None
    assert np.isfinite(flown.depth_m).any()
    (again,) = images(recorded(tmp_path / "run.mcap", [flown]))
    assert_same(flown, again)


def test_an_image_from_elsewhere_and_a_mixture_are_recorded(tmp_path: Path) -> None:
    flown = drawn()[0]
    others = [replace(flown, drawing=None), replace(flown, source="mixed", drawing=None)]
    again = images(recorded(tmp_path / "run.mcap", others, facts={}))
    for before, after in zip(others, again, strict=True):
        assert_same(before, after)


@pytest.mark.parametrize(
    ("facts", "why"),
    [
        ({}, "the recording has no world"),
        ({"mode": "wil", "world": '{"schema": "wil/world/1"}'}, "its world cannot be read"),
        ({**FACTS, "world": EMPTY}, "it was flown by an unknown version"),
        ({**FACTS, "world": OTHER}, "it was flown by an unknown version"),
        (
            {**FACTS, "world": OTHER, "program": flown_program()},
            "this machine or its libraries draw differently",
        ),
        (
            {**FACTS, "world": OTHER, "shapes_twin": "0", "program": "0.1"},
            "meshes or textures of the world have changed since and it was flown by 0.1, and this",
        ),
    ],
)
def test_an_image_that_would_be_another_is_refused_with_the_reason(
    facts: dict[str, str], why: str, tmp_path: Path
) -> None:
    recording = recorded(tmp_path / "run.mcap", drawn(), facts)
    with pytest.raises(NotDrawnAgainError, match=why) as refused:
        list(recording)
    assert "the image of twin/camera at 0.000 s is not in the recording" in str(refused.value)
    refusals: list[NotDrawnAgainError] = []
    assert not images(Recording(tmp_path / "run.mcap", not_drawn=refusals.append))
    assert len(refusals) == 10


CRATE = """{
  "schema": "wil/world/1",
  "origin": {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 488.0},
  "objects": {"crate": {"shape": {"mesh": {"file": "crate.obj"}}, "pose": {"north_m": 3}}}
}"""


def of_a_crate(folder: Path, name: str, half_m: float) -> Recording:
    """Return a recording of a flight before a mesh of a size, which is in one file for all."""
    at = (-half_m, half_m)
    corners = "".join(f"v {x} {y} {z}\n" for x in at for y in at for z in at)
    sides = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
    (folder / "crate.obj").write_text(corners + sides)
    facts = {**FACTS, "world": CRATE, "world_file": str(folder / "world.yaml")}
    world = world_in(facts)
    assert world is not None
    scene = world.scene("wil", "Wv")
    camera = OnDemandCamera(
        source=ThroughLens(WorldImages(scene=scene, events={})), intrinsics=BARREL
    )
    flown = run_virtual(camera.ask(Pose.of(0.0, 0.0, 0.0), 0.1))
    return recorded(folder / name, [flown], {**facts, "shapes_twin": scene_digest(scene)})


def test_a_mesh_that_changes_between_runs_is_read_anew_in_one_process(tmp_path: Path) -> None:
    """A console and a program of a user read many runs, and fly others meanwhile."""
    assert len(images(of_a_crate(tmp_path, "1.mcap", 0.5))) == 1
    second = of_a_crate(tmp_path, "2.mcap", 0.7)
    assert len(images(second)) == 1
    third = of_a_crate(tmp_path, "3.mcap", 0.4)
    drawers.cache_clear()
    with pytest.raises(NotDrawnAgainError, match="meshes or textures of the world have changed"):
        images(second)
    assert len(images(third)) == 1
    of_a_crate(tmp_path, "4.mcap", 0.7)
    assert len(images(second)) == 1


def test_a_world_whose_description_has_an_emoji_is_drawn_again(tmp_path: Path) -> None:
    described = json.dumps({**json.loads(WORLD), "description": "Gate \U0001f681, C:\\ud83d"})
    facts = {**FACTS, "world": described}
    world = world_in(facts)
    assert world is not None
    assert world.description == "Gate \U0001f681, C:\\ud83d"
    assert len(images(recorded(tmp_path / "run.mcap", drawn(), facts))) == 10


def test_the_noise_of_many_runs_is_not_kept() -> None:
    reading = drawn()[0]
    assert reading.drawing is not None
    assert reading.drawing.effects is not None
    world = world_in(FACTS)
    assert world is not None
    again = ImageRedrawer(world.scene("wil", "Wv"))
    tracemalloc.start()
    for seed in range(60):
        effects = replace(reading.drawing.effects, seed=(seed,))
        drawing = replace(reading.drawing, effects=effects)
        again.image(drawing, reading.intrinsics, want_depth=False, want_ids=False)
    kept_bytes, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept_bytes < 12 * (120 + 128) * (160 + 128) * 3 * 2


@pytest.mark.parametrize(
    ("place", "value", "what"),
    [
        (("intrinsics", "fx_px"), 0.0, "focal lengths of 0.0"),
        (("intrinsics", "fy_px"), None, "focal lengths of"),
        (("intrinsics", "width_px"), 60_000_000, "an image of 60000000 x 120 pixels"),
        (("intrinsics", "height_px"), -5, "an image of 160 x -5 pixels"),
        (("intrinsics", "cx_px"), 1e300, "its axis at"),
        (("drawing", "camera_pose", "q_wxyz"), [None, 0, 0, 0], "a quaternion of"),
        (("drawing", "camera_pose", "position_ned_m"), [None, 0, 0], "a position of"),
        (("drawing", "effects", "noise_roll_px"), [500, 0], "noise that is moved by"),
        (("drawing", "effects", "noise_roll_px"), [math.inf, 0], "infinity"),
        pytest.param(("drawing", "effects", "gain"), 10**400, "too large", id="large"),
        (("intrinsics", "distortion"), [0.1, 0.1, 0.1], "OpenCV"),
    ],
)
def test_a_drawing_that_no_flight_made_is_refused_before_it_crashes_the_renderer(
    place: tuple[str, ...], value: object, what: str
) -> None:
    flown = drawn()[3]
    assert flown.drawing is not None
    document = json.loads(json.dumps(drawing_body(flown, flown.drawing)[1]))
    document["wil"] |= {"source": "twin", "t_s": 0.3}
    assert RecordedImages(FACTS).image(document).shape == (120, 160, 3)
    *path, last = place
    part = document["wil"]
    for name in path:
        part = part[name]
    part[last] = value
    with pytest.raises(ValueError, match=what):
        RecordedImages(FACTS).image(document)


def test_other_readings_of_a_recording_do_not_need_its_world(tmp_path: Path) -> None:
    flown = drawn()
    recording = recorded(tmp_path / "run.mcap", [*flown, replace(flown[0], source="real")], {})
    assert list(recording.readings("imu")) == []
    with pytest.raises(NotDrawnAgainError):
        list(recording.readings("camera"))


Fly = Callable[..., tuple[RunResult, Path]]


def by_stamp(folder: Path) -> dict[tuple[str, int], CameraReading]:
    found = images(Recording(folder / "run.mcap"))
    return {(one.source, one.seq): one for one in found if isinstance(one, CameraReading)}


def test_a_flight_records_no_image_that_it_drew_and_all_read_it(
    fly_run: Fly, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The default against all images, raw: equal flights, equal images, a tenth of the disk."""
    _, raw = fly_run(sets=(*STEP, "record.pictures=raw"), cameras=SMALL_CAMERAS)
    _, needed = fly_run(sets=STEP, cameras=SMALL_CAMERAS)
    whole, again = by_stamp(raw), by_stamp(needed)
    assert whole.keys() == again.keys()
    assert {source for source, _ in again} == {"real", "twin", "mixed"}
    for key, before in whole.items():
        if before.source != "mixed":
            assert again[key].drawing is not None
            assert_same(replace(before, drawing=again[key].drawing), again[key])
    for name in ("trajectory.csv", "judged.msgpack", "real.tlog", "twin.tlog"):
        assert (raw / name).read_bytes() == (needed / name).read_bytes()
    assert main(["replay", str(needed), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    (combination,) = report["combinations"]
    assert (combination["exact"], combination["compared"] > 20) == (True, True)


def test_what_a_twin_alone_saw_is_drawn_again_for_its_video(fly_run: Fly, tmp_path: Path) -> None:
    _, folder = fly_run(mode="sim", sets=STEP, cameras=SMALL_CAMERAS)
    assert (folder / "run.mcap").stat().st_size < 100_000
    assert make_video(folder)
    video = cv2.VideoCapture(str(folder / "mixed.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == len(by_stamp(folder)) > 20
