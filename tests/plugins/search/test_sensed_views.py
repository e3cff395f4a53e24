"""What a run's sensors had before them: from its judge log, by the geometry of its world."""

import math
import os
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import RunPlan, load_campaign
from wil_campaign.orchestrator.recording.judge_log_file import FILE_NAME, JudgeLogWriter
from wil_campaign.plugins.search.exploration.sensed import SensedView
from wil_campaign.plugins.search.sensed_views import sensed_views
from wil_campaign.safety.evaluation.judge_log import LoggedWorldEvent
from wil_campaign.safety.model.samples import PoseSample, Stage, StageSample
from wil_campaign.worlds.frames import Pose

SENSORS = """
    sensors:
      front: {type: camera, rate_hz: 5, width_px: 64, height_px: 48, fov_deg: 80}
      stereo: {type: depth, rate_hz: 5, width_px: 64, height_px: 48, fov_deg: 80}
      scan: {type: lidar, rate_hz: 5, beams: 80}
      points: {type: lidar_points, rate_hz: 5, columns: 80, rings: 5}
      pressure: {type: imu, rate_hz: 5}
"""
WORLD = """
objects:
  hall:
    shape: {room: {size_north_m: 40, size_east_m: 40, height_m: 4}}
  post:
    shape: {box: {size_m: [0.4, 0.4, 3]}}
    pose: {north_m: 5, east_m: 0, up_m: 1.5}
  hidden:
    shape: {box: {size_m: [0.1, 0.1, 0.1]}}
    pose: {north_m: 9, east_m: 0, up_m: 1.2}
  walker:
    shape: {box: {size_m: [0.4, 0.4, 3]}}
    pose: {north_m: 0, east_m: 3, up_m: 1.5}
    motion:
      start: {on: goal}
      waypoints: [{north_m: 0, east_m: 9, up_m: 1.5, speed_m_s: 3}]
"""


@pytest.fixture(name="plan")
def made_plan(tmp_path: Path) -> RunPlan:
    path = write_hover(tmp_path)
    vehicle = "{link: embedded, autopilot: px4}"
    text = path.read_text().replace(
        f"vehicles: {{twin: {vehicle}}}",
        f"vehicles:\n  twin:\n    link: embedded\n    autopilot: px4{SENSORS}",
    )
    path.write_text(text)
    world = tmp_path / "world.yaml"
    world.write_text(world.read_text() + WORLD)
    return load_campaign(path).runs[0]


def write_log(folder: Path, path_m: list[tuple[float, float]], *, last: Stage = "land") -> None:
    """A judge log of poses (north, yaw) at 1.2 m, one each second, the goal from 10 s on."""
    with JudgeLogWriter(path=folder / FILE_NAME) as log:
        log.write(StageSample(0.0, "takeoff"))
        log.write(PoseSample(1.0, "twin", Pose.of(4.4, 0.0, 1.2), (0.0, 0.0, 0.0)))
        log.write(LoggedWorldEvent(10.0, "goal"))
        log.write(StageSample(10.0, "goal"))
        for second, (north_m, yaw_rad) in enumerate(path_m):
            pose = Pose.of(north_m, 0.0, 1.2, yaw_rad=yaw_rad)
            log.write(PoseSample(10.0 + second, "twin", pose, (0.0, 0.0, 0.0)))
        log.write(StageSample(10.0 + len(path_m), last))
        close = Pose.of(4.6, 0.0, 1.2)
        log.write(PoseSample(20.0 + len(path_m), "twin", close, (0.0, 0.0, 0.0)))


def views(plan: RunPlan, folder: Path) -> dict[tuple[str, str], SensedView]:
    return {
        (sensed_view.sensor, sensed_view.object): sensed_view
        for sensed_view in sensed_views(plan, folder)
    }


def test_a_camera_sees_objects_in_sectors_and_distances_while_the_goal_is_flown(
    plan: RunPlan, tmp_path: Path
) -> None:
    write_log(tmp_path, [(0.0, 0.0), (3.0, 0.0), (3.0, math.radians(30.0))])
    found = views(plan, tmp_path)
    assert {name for sensor, name in found if sensor == "front"} == {"post", "hidden", "walker"}
    post = found["front", "post"]
    # 4.8 m and 1.8 m ahead, in the middle; then, the vehicle turned right, on the left.
    assert post.nearest_m == pytest.approx(1.8, abs=0.02)
    assert {level for _, level in post.cells} == {2, 4}
    assert {sector for sector, level in post.cells if level == 4} <= {3, 4}
    assert min(sector for sector, _ in post.cells) <= 1
    assert 0.02 < post.largest_share < 0.4
    # Neither what stands behind something, nor the walls of a room.
    assert found["front", "hidden"].cells == ()
    assert found["front", "hidden"].nearest_m is None


def test_ranging_sensors_see_the_nearest_thing_of_each_sector_and_no_floor(
    plan: RunPlan, tmp_path: Path
) -> None:
    write_log(tmp_path, [(0.0, 0.0), (3.0, 0.0)])
    found = views(plan, tmp_path)
    stereo, scan, points = (found[name, ""] for name in ("stereo", "scan", "points"))
    assert stereo.reduced == ("55522555", "55544555")
    assert stereo.nearest_m == pytest.approx(1.8, abs=0.05)
    # The walker is 3 m to the right at the start, and farther a second later.
    assert len(scan.reduced) == 2
    assert {level for sector, level in scan.cells if sector == 5} | {
        level for sector, level in scan.cells if sector == 6
    } >= {3, 4}
    assert scan.cells == points.cells
    assert ("pressure", "") not in found


def test_nothing_is_counted_before_the_goal_after_the_landing_or_without_a_judge_log(
    plan: RunPlan, tmp_path: Path
) -> None:
    assert sensed_views(plan, tmp_path) == ()
    write_log(tmp_path, [(0.0, 0.0)])
    assert views(plan, tmp_path)["front", "post"].nearest_m == pytest.approx(4.8, abs=0.02)
    log = tmp_path / FILE_NAME
    log.write_bytes(b"no log")
    assert sensed_views(plan, tmp_path) == ()
    log.unlink()
    os.mkfifo(log)  # nobody writes into it
    assert sensed_views(plan, tmp_path) == ()
