"""Sensors of every type in a campaign file, and what is wrong with them."""

import math

import pytest

from tests.campaigns.conftest import Files
from wil_campaign.campaigns.values.sensor_setups import (
    CameraSetup,
    DepthSetup,
    OtherSensorSetup,
    sensor_options_of,
)
from wil_campaign.plugins.lidar.lidar import LidarOptions
from wil_campaign.vehicles.readings import sensor_names

ALL = """      stereo: {type: depth, rate_hz: 10, width_px: 160, height_px: 120, fov_deg: 80}
      lidar: {type: lidar, beams: 181, fov_deg: 180, range_max_m: 6, mount: {down_m: -0.05}}
      cloud: {type: lidar_points, rate_hz: 5, columns: 90, rings: 4}
      below: {type: rangefinder}
      gnss: {type: gps}
      mocap: {type: pose, rate_hz: 50}
      imu: {type: imu}
      ear: {type: microphone, sample_rate_hz: 8000, block_samples: 400}
"""
PINHOLE = "type: camera, rate_hz: 5, width_px: 64, height_px: 48, fov_deg: 90"
CAMERA = "      camera: {type: camera, rate_hz: 15, width_px: 320, height_px: 240, fov_deg: 69}\n"


def with_sensors(files: Files, text: str) -> None:
    path = files.folder / "campaign.yaml"
    path.write_text(path.read_text().replace(CAMERA, CAMERA + text))


def test_every_type_of_reading_has_its_sensor(files: Files) -> None:
    with_sensors(files, ALL)
    sensors = {
        sensor.name: sensor for sensor in files.load().setups["large"].vehicles["real"].sensors
    }
    kinds_of_all = {sensor.kind for sensor in sensors.values()}
    assert kinds_of_all == set(sensor_names()), "ALL and CAMERA above name each sensor type once"
    assert isinstance(sensors["camera"], CameraSetup)
    assert isinstance(sensors["stereo"], DepthSetup)
    lidar, below = sensor_options_of(sensors["lidar"], LidarOptions), sensors["below"]
    assert lidar is not None
    assert lidar.pattern.start_angle_rad == pytest.approx(-math.pi / 2)
    assert lidar.pattern.step_rad == pytest.approx(math.radians(1.0))
    assert (lidar.range_min_m, lidar.range_max_m) == (None, 6.0)
    assert lidar.mounted.position_ned_m == (0.0, 0.0, -0.05)
    assert isinstance(below, OtherSensorSetup)
    assert below.mount.to_parent((1.0, 0.0, 0.0)) == pytest.approx((0.0, 0.0, 1.0), abs=1e-12)
    assert sensors["ear"].rate_hz == 20.0


def test_a_full_turn_has_no_beam_twice(files: Files) -> None:
    with_sensors(files, "      lidar: {type: lidar, beams: 360}\n")
    lidar = files.load().setups["large"].vehicles["real"].sensors[1]
    options = sensor_options_of(lidar, LidarOptions)
    assert options is not None
    assert options.pattern.step_rad == pytest.approx(math.radians(1.0))


def test_a_distortion_comes_with_its_intrinsics(files: Files) -> None:
    with_sensors(
        files,
        "      wide: {type: camera, rate_hz: 5, width_px: 64, height_px: 48, fov_deg: 90,"
        " distortion: [-0.2, 0.05, 0, 0]}\n",
    )
    wide = files.load().setups["large"].vehicles["real"].cameras[1]
    assert wide.intrinsics.distortion == (-0.2, 0.05, 0.0, 0.0)


@pytest.mark.parametrize(
    ("sensor", "said"),
    [
        ("{type: radar}", "must be camera, depth, pose, lidar, lidar_points"),
        ("{rate_hz: 5}", "missing key 'type'"),
        ("{type: imu, rate_hz: 400}", "must be at most 250"),
        ("{type: lidar, beems: 5}", "unknown key 'beems'"),
        ("{type: lidar, range_min_m: 3, range_max_m: 2}", "must be more than range_min_m, 3"),
        ("{type: lidar_points, lowest_deg: 5, highest_deg: 4}", "must be at least lowest_deg, 5"),
        ("{type: microphone, block_samples: 16}", "gives 1000 blocks/s; at most 250"),
        (
            f"{{{PINHOLE}, distortion: [1, 2, 3]}}",
            "has 3 numbers; OpenCV's models have 4",
        ),
        (
            f"{{{PINHOLE}, distortion: [-3, 0, 0, 0]}}",
            "the lens model folds over",
        ),
        ("{type: depth, rate_hz: 5, width_px: 64, height_px: 48}", "needs fov_deg or fx_px"),
        (f"{{{PINHOLE[:-2]}5.0e-324}}", "must be at least 0.001, is 5e-324"),
    ],
)
def test_a_wrong_sensor_is_reported_at_its_place(files: Files, sensor: str, said: str) -> None:
    path = files.folder / "campaign.yaml"
    path.write_text(path.read_text().replace(CAMERA, f"{CAMERA}      odd: {sensor}\n", 1))
    faults = files.faults()
    assert len(faults) == 1, faults
    assert faults[0].startswith("campaign.yaml:12:")
    assert said in faults[0]


def test_a_mixed_sensor_must_be_carried_as_its_type(files: Files) -> None:
    with_sensors(files, ALL)
    path = files.folder / "recipe.yaml"
    path.write_text(
        path.read_text().replace(
            "sensors: {camera: {type: camera, rate_hz: 15}}",
            "sensors: {camera: {type: camera, rate_hz: 15}, lidar: {type: imu}, wind: {type: gps}}",
        )
    )
    faults = files.faults()
    assert any("vehicle 'real' has no imu 'lidar'" in fault for fault in faults)
    assert any("vehicle 'twin' has no gps 'wind'" in fault for fault in faults)
