"""What a campaign may say of the sources of other sensors than cameras, and what is refused."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.campaigns.conftest import Files
from wil_campaign.campaigns.values.external_setups import ReadingSourceSetup

CAMERA = "camera: {type: camera, rate_hz: 15, width_px: 320, height_px: 240, fov_deg: 69}"
REAL = f"    pose_source: mocap\n    sensors:\n      {CAMERA}\n"
TWIN = f"    autopilot: ardupilot\n    sensors:\n      {CAMERA}\n"


def with_sensor(files: Files, sensor: str, *, of: str = "real") -> None:
    old = REAL if of == "real" else TWIN
    files.change(old, f"{old}      one: {{{sensor}}}\n")


def source(files: Files, of: str = "real") -> ReadingSourceSetup:
    vehicles = files.load().setups["large"].vehicles
    ((_, found),) = {str(name): vehicle for name, vehicle in vehicles.items()}[of].sourced
    return found


@pytest.mark.parametrize(
    ("sensor", "of", "message"),
    [
        ("type: rangefinder, source: mavlink", "real", "DISTANCE_SENSOR"),
        ("type: lidar, source: mavlink", "real", "OBSTACLE_DISTANCE"),
        ("type: gps, source: mavlink", "real", "GPS_RAW_INT"),
        ("type: imu, source: mavlink", "real", "HIGHRES_IMU"),
        ("type: imu, source: mavlink", "twin", "RAW_IMU"),
        ("type: imu, source: {address: mavlink, message: SCALED_IMU}", "real", "SCALED_IMU"),
        ("type: pose, rate_hz: 10, source: mavlink", "real", None),
    ],
)
def test_each_type_has_its_message(files: Files, sensor: str, of: str, message: str | None) -> None:
    with_sensor(files, sensor, of=of)
    found = source(files, of)
    assert (found.kind, found.message, found.shown_as) == ("mavlink", message, "live")
    assert not list(files.load().setups["large"].needing_wall_clock())


def test_the_autopilot_is_asked_for_the_message_as_often_as_the_sensor_measures(
    files: Files,
) -> None:
    with_sensor(files, "type: rangefinder, rate_hz: 12, source: mavlink")
    (line,) = files.load().setups["large"].vehicles["real"].rates.sensors
    number = mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR
    assert (line.message_id, line.rate_hz, line.required) == (number, 12.0, False)


def test_a_publisher_needs_the_wall_clock_and_a_recording_does_not(files: Files) -> None:
    address = "tcp://127.0.0.1:5580"
    with_sensor(files, f"type: microphone, source: {{address: '{address}', name: ear}}")
    found = source(files)
    assert (found.kind, found.address, found.name) == ("zmq", address, "ear")
    needs = [said for _, said in files.load().setups["large"].needing_wall_clock()]
    assert needs == [f"the microphone at {address}"]


def test_a_recording_is_found_beside_the_campaign(files: Files) -> None:
    (files.folder / "run.mcap").write_bytes(b"")
    with_sensor(files, "type: lidar, source: {address: run.mcap, topic: /real/lidar}")
    found = source(files)
    assert (found.kind, found.topic, found.shown_as) == ("mcap", "/real/lidar", "file")
    assert found.address == str((files.folder / "run.mcap").resolve())


DEPTH = "type: depth, rate_hz: 30, width_px: 64, height_px: 48, fov_deg: 69"


@pytest.mark.parametrize(
    ("address", "kind"),
    [
        ("tcp://127.0.0.1:5580", "zmq"),
        ("rtp://0.0.0.0:5600", "rtp"),
        ("realsense://012345", "realsense"),
    ],
)
def test_a_depth_camera_has_live_sources(files: Files, address: str, kind: str) -> None:
    with_sensor(files, f"{DEPTH}, source: '{address}'")
    found = source(files)
    assert (found.kind, found.address, found.shown_as) == (kind, address, "live")
    needs = [said for _, said in files.load().setups["large"].needing_wall_clock()]
    assert needs == [f"the depth at {address}"]


def test_a_depth_camera_of_the_twin_that_only_streams_cannot_be_registered(files: Files) -> None:
    for of in ("real", "twin"):
        with_sensor(files, f"{DEPTH}, source: 'tcp://127.0.0.1:5580'", of=of)
    recipe = (
        "schema: wil/recipe/1\nsensors: {one: {type: depth}}\ncombine:\n"
        "  - {sensor: one, transform: [{register: {pose: real}}],"
        " merge: {aggregate: {by: min}}, publish: [real]}\n"
    )
    (files.folder / "recipe.yaml").write_text(recipe)
    assert any(
        "cannot provide a reading from a requested pose" in fault for fault in files.faults()
    )


@pytest.mark.parametrize(
    ("sensor", "of", "said"),
    [
        (f"{DEPTH}, source: mavlink", "real", "no message with readings of type depth"),
        (f"{DEPTH}, source: 'rtp://0.0.0.0'", "real", "is not rtp://HOST:PORT"),
        (f"{DEPTH}, source: 'realsense://'", "real", "is not realsense://SERIAL"),
        ("type: gps, source: 'realsense://any'", "real", "the sensor is a gps"),
        (f"{DEPTH}, source: none.mcap", "real", "no file or folder 'none.mcap'"),
        ("type: microphone, source: mavlink", "real", "MAVLink has no message with readings"),
        ("type: lidar_points, source: mavlink", "real", "MAVLink has no message with readings"),
        (
            "type: imu, source: {address: mavlink, message: GPS_RAW_INT}",
            "real",
            "has no readings of type imu; known are: HIGHRES_IMU",
        ),
        (
            "type: imu, source: {address: mavlink, message: RAW_IMU}",
            "real",
            "gives RAW_IMU no unit",
        ),
        (
            "type: pose, source: {address: mavlink, message: ODOMETRY}",
            "real",
            "the vehicle's estimate",
        ),
        ("type: lidar, mount: {yaw_deg: 90}, source: mavlink", "real", "cannot be turned"),
        ("type: lidar, source: mavlink", "twin", "ArduPilot sends no OBSTACLE_DISTANCE"),
        ("type: gps, source: {address: mavlink, id: 1}", "real", "applies to a rangefinder only"),
        (
            "type: imu, source: {address: mavlink, undulation_m: 40}",
            "real",
            "applies to a gps only",
        ),
        ("type: gps, source: {address: mavlink, topic: x}", "real", "no effect on a source of mav"),
        (
            "type: gps, source: {address: 'tcp://h:1', id: 1}",
            "real",
            "no effect on a source of zmq",
        ),
        ("type: gps, source: udp://0.0.0.0:5570", "real", "must be mavlink, tcp://HOST:PORT"),
        ("type: gps, source: tcp://0.0.0.0:99999", "real", "must be mavlink, tcp://HOST:PORT"),
        ("type: gps, source: none.mcap", "real", "no file or folder 'none.mcap'"),
    ],
)
def test_an_impossible_reading_source_is_named_at_its_place(
    files: Files, sensor: str, of: str, said: str
) -> None:
    with_sensor(files, sensor, of=of)
    (fault,) = files.faults()
    assert said in fault
    assert "campaign.yaml:" in fault


def test_a_twin_that_is_placed_sends_nothing_by_mavlink(files: Files) -> None:
    with_sensor(files, "type: gps, source: mavlink", of="twin")
    files.change("    autopilot: ardupilot\n", "    autopilot: ardupilot\n    coupling: placed\n")
    assert any("a placed twin does not fly" in fault for fault in files.faults())
