"""A recorded run as a bag of ROS 2, as other people's tools read it."""

import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader

from tests.orchestrator.reading.flown_campaign import Flight
from tests.orchestrator.recording.test_recorded_images import FACTS, drawn
from tests.orchestrator.recording.test_recorded_images import recorded as recorded_without_images
from tests.plugins.ros2.messages.test_ros_messages import READINGS
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.recording.mcap.mcap_settings import RecordingSettings
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.orchestrator.recording.trajectory import TrajectoryRow, TrajectoryWriter
from wil_campaign.plugins.ros2.messages.ros_types import ros_types
from wil_campaign.vehicles.readings import MicrophoneReading
from wil_campaign.worlds.frames import Pose

EPOCH_NS = round(VIRTUAL_EPOCH_S * 1e9)
POSE = Pose((1.0, 2.0, -3.0))
"""North, east, down; heads north."""
MOUNTS = {
    "real/camera": {
        "pose": {"position_ned_m": (0.1, 0.0, 0.0), "q_wxyz": (1, 0, 0, 0)},
        "stabilized": False,
    }
}
SOUND = MicrophoneReading(1.0, 1.0, 0, "real", np.zeros(4, np.int16), 8000, 1.0, sensor="ear")


def row(t_s: float, vehicle: str) -> TrajectoryRow:
    return TrajectoryRow(t_s, vehicle, "goal", "", True, POSE, (1.0, 0.0, 0.0), None, None, "")


def record(folder: Path, *, mode: str = "wil", mixed: frozenset[str] = frozenset()) -> Path:
    """Write the files of a run: every kind of reading of real and twin, those of `mixed` mixed."""
    facts = {
        "mode": mode,
        "campaign": json.dumps({"goal": {"altitude_m": 2.0}}),
        "mounts": json.dumps(MOUNTS),
    }
    path = folder / "run.mcap"
    with McapRecorder(
        path=path,
        epoch_s=VIRTUAL_EPOCH_S,
        clock="virtual",
        settings=RecordingSettings(),
        facts=facts,
    ) as recorder:
        recorder.event(0.5, "info", "stage", "goal")
        for reading in (*READINGS, SOUND):
            for source in ("real", "twin"):
                recorder.reading(reading.sensor, replace(reading, source=source))
            if reading.sensor in mixed:
                recorder.reading(reading.sensor, replace(reading, source="mixed"))
        recorder.event(1.5, "error", "FAIL", "hit the gate")
    with TrajectoryWriter(path=folder / "trajectory.csv") as rows:
        for t_s in (0.9, 1.4):
            rows.write(row(t_s, "real"))
            rows.write(row(t_s, "twin"))
    flight = replace(Flight(case="default", mode="sim", rep=1).result(), verdict="FAIL")
    (folder / "result.json").write_text(to_json(replace(flight, reason="hit the gate")))
    return path


def export(run: Path, file: Path, *options: str) -> int:
    return main(["export", str(run), "--ros2", str(file), *options])


def decoded(file: Path) -> dict[str, list[Any]]:
    """Return the messages of a bag by topic, as mcap-ros2-support decodes them."""
    found: dict[str, list[Any]] = {}
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for _, channel, _, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append(message)
    return found


def recorded(run: Path) -> Counter[str]:
    with run.open("rb") as stream:
        return Counter(channel.topic for _, channel, _ in make_reader(stream).iter_messages())


@pytest.mark.parametrize("distribution", ["humble", "jazzy", "kilted"])
def test_every_reading_is_in_the_bag_and_is_decoded_by_others(
    tmp_path: Path, distribution: str
) -> None:
    sensors = {reading.sensor for reading in READINGS}
    run, bag = record(tmp_path, mixed=frozenset(sensors)), tmp_path / "flight.mcap"
    assert export(tmp_path, bag, "--distribution", distribution) == 0
    messages, counts = decoded(bag), recorded(run)
    topics = {"camera": "image_raw/compressed", "depth": "image_raw", "down": "range"}
    topics |= {"gps": "fix", "mocap": "pose", "imu": "data"}
    for sensor, leaf in topics.items():
        for prefix, source in (("", "mixed"), ("/real", "real"), ("/twin", "twin")):
            found = messages[f"{prefix}/{sensor}/{leaf}"]
            assert len(found) == counts[f"/{source}/{sensor}"] == 1, (prefix, sensor)
            assert found[0].header.stamp.sec == VIRTUAL_EPOCH_S + 1
    assert len(messages["/lidar/scan"]) == len(messages["/lidar/points"]) == 1
    assert len(messages["/rosout"]) == counts["/log"]
    assert [one.data for one in messages["/wil/stage"]] == ["goal"]
    assert [one.data for one in messages["/wil/verdict"]] == ["FAIL: hit the gate"] * 2
    assert json.loads(messages["/wil/goal"][0].data) == {"altitude_m": 2.0}
    times = [one.clock.sec * 10**9 + one.clock.nanosec for one in messages["/clock"]]
    assert times == sorted(times)
    assert times[-1] >= EPOCH_NS + 1.5e9


def test_rosbags_reads_the_bag_with_its_types_and_qualities(tmp_path: Path) -> None:
    record(tmp_path, mixed=frozenset({"camera"}))
    bag, types = tmp_path / "flight.mcap", ros_types("jazzy")
    assert export(tmp_path, bag) == 0
    with Reader(bag) as reader:
        for connection, _, data in reader.messages():
            types.deserialize(data, connection.msgtype)
        durable = {
            one.topic
            for one in reader.connections
            if one.ext.offered_qos_profiles[0].durability is QosDurability.TRANSIENT_LOCAL
        }
        assert reader.message_count == sum(one.msgcount for one in reader.connections)
    assert durable == {"/tf_static", "/wil/goal", "/wil/stage", "/wil/verdict", "/rosout"}


def test_an_image_has_the_recordings_bytes_unless_it_is_to_be_decoded(tmp_path: Path) -> None:
    run = record(tmp_path, mixed=frozenset({"camera"}))
    assert export(run, tmp_path / "jpeg.mcap") == 0
    assert export(run, tmp_path / "raw.mcap", "--decode") == 0
    small = decoded(tmp_path / "jpeg.mcap")["/camera/image_raw/compressed"][0]
    assert small.format == "jpeg"
    pixels = cv2.imdecode(np.frombuffer(small.data, np.uint8), cv2.IMREAD_COLOR)
    raw = decoded(tmp_path / "raw.mcap")
    image = raw["/camera/image_raw"][0]
    assert (image.encoding, image.height, image.width) == ("bgr8", 6, 8)
    assert pixels is not None
    assert bytes(image.data) == pixels.tobytes()
    assert "/camera/image_raw/compressed" not in raw
    assert raw["/camera/camera_info"][0].header.frame_id == image.header.frame_id


def test_an_image_that_is_drawn_again_is_encoded_as_it_would_have_been_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flown, campaign = drawn(side="real"), json.dumps({"record": {"quality": 70}})
    recorded_without_images(
        tmp_path / "run.mcap", flown, {**FACTS, "mode": "real", "campaign": campaign}
    )
    assert export(tmp_path, tmp_path / "flight.mcap") == 0
    for before, after in zip(
        flown, decoded(tmp_path / "flight.mcap")["/camera/image_raw/compressed"], strict=True
    ):
        jpeg = cv2.imencode(".jpg", before.image_bgr, [cv2.IMWRITE_JPEG_QUALITY, 70])[1]
        assert bytes(after.data) == jpeg.tobytes()
    assert export(tmp_path, tmp_path / "raw.mcap", "--decode") == 0
    raw = decoded(tmp_path / "raw.mcap")["/camera/image_raw"]
    assert [bytes(image.data) for image in raw] == [one.image_bgr.tobytes() for one in flown]

    without = tmp_path / "without.mcap"
    recorded_without_images(without, flown, {"mode": "real"})
    assert export(without, tmp_path / "none.mcap") == 2
    assert "cannot be drawn again: the recording has no world" in capsys.readouterr().err
    assert not (tmp_path / "none.mcap").exists()


def test_poses_are_transforms_and_odometry_in_the_frames_of_ros(tmp_path: Path) -> None:
    record(tmp_path, mixed=frozenset({"camera"}))
    assert export(tmp_path, tmp_path / "flight.mcap") == 0
    messages = decoded(tmp_path / "flight.mcap")
    moving = [transform for message in messages["/tf"] for transform in message.transforms]
    frames = Counter((one.header.frame_id, one.child_frame_id) for one in moving)
    assert frames == {("odom", "base_link"): 2, ("map", "twin/base_link"): 2}
    place = moving[0].transform.translation
    assert (place.x, place.y, place.z) == (2.0, 1.0, 3.0)  # east, north, up
    assert len(messages["/odom"]) == len(messages["/pose"]) == 2
    assert messages["/odom"][0].twist.twist.linear.x == pytest.approx(1.0)  # ahead: north
    fixed = {
        transform.child_frame_id: transform for transform in messages["/tf_static"][-1].transforms
    }
    assert fixed["odom"].header.frame_id == "map"
    assert fixed["camera_optical"].transform.translation.x == pytest.approx(0.1)
    assert messages["/camera/camera_info"][0].header.frame_id == "camera_optical"
    assert messages["/twin/imu/data"][0].header.frame_id == "twin/imu"
    assert {"imu", "twin/imu"} <= set(fixed)


def test_unmixed_readings_have_the_topics_of_the_flight(tmp_path: Path) -> None:
    """In mode sim it is the twin's, in wil the judged vehicle's where the recipe mixes nothing."""
    record(tmp_path, mode="sim")
    assert export(tmp_path, tmp_path / "sim.mcap") == 0
    messages = decoded(tmp_path / "sim.mcap")
    assert messages["/imu/data"][0].header.frame_id == "imu"
    assert "/twin/imu/data" not in messages
    (tmp_path / "wil").mkdir()
    record(tmp_path / "wil", mixed=frozenset({"camera"}))
    assert export(tmp_path / "wil", tmp_path / "wil.mcap") == 0
    messages = decoded(tmp_path / "wil.mcap")
    assert {"/imu/data", "/twin/imu/data", "/real/camera/camera_info"} <= set(messages)
    assert "/real/imu/data" not in messages


def test_readings_without_a_message_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(tmp_path)
    (tmp_path / "trajectory.csv").unlink()
    assert export(tmp_path, tmp_path / "flight.mcap") == 0
    said = capsys.readouterr()
    assert "left out: 1 readings of /real/ear, for which there is no message" in said.err
    assert "no poses, or not all of them: " in said.err
    assert "trajectory.csv" in said.err
    assert "/tf" not in decoded(tmp_path / "flight.mcap")


def test_a_recording_that_is_cut_off_is_named_and_exported_on_request(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = record(tmp_path)
    run.write_bytes(run.read_bytes()[:-40])
    bag = tmp_path / "flight.mcap"
    assert export(run, bag) == 2
    assert "run.mcap: is cut after byte" in capsys.readouterr().err
    assert not list(tmp_path.glob("*flight*"))
    assert export(run, bag, "--cut") == 0
    assert decoded(bag)["/imu/data"]


@pytest.mark.parametrize(
    ("run", "file", "said"),
    [
        ("nothing", "flight.mcap", "nothing: there is no such recording"),
        (".", "there.mcap", "there.mcap: is there already"),
        (".", "flight.bag", "name a file that ends in .mcap"),
        (".", "no/flight.mcap", "there is no folder"),
        ("result.json", "flight.mcap", "result.json: not an MCAP file"),
        ("there.mcap", "flight.mcap", "is no recording of a run: it has no record wil.recording"),
        ("wild.mcap", "flight.mcap", "wild.mcap: cannot be read: KeyError: 'data'"),
    ],
)
def test_a_run_that_cannot_be_exported_is_named_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], run: str, file: str, said: str
) -> None:
    recorded_run = record(tmp_path)
    assert export(recorded_run, tmp_path / "there.mcap") == 0
    before = (tmp_path / "there.mcap").read_bytes()
    capsys.readouterr()
    if run == "wild.mcap":
        _without_data(tmp_path / run)
    assert export(tmp_path / run, tmp_path / file) == 2
    assert said in capsys.readouterr().err
    assert (tmp_path / "there.mcap").read_bytes() == before
    assert not list(tmp_path.glob("*flight*"))


def _without_data(path: Path) -> None:
    """Write a recording with an image that has no data, as nobody's recorder would."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.add_metadata("wil.recording", {"mode": "sim"})
        schema = writer.register_schema("foxglove.CompressedImage", "jsonschema", b"{}")
        facts = {"source": "twin", "sensor": "camera", "part": "reading"}
        channel = writer.register_channel("/twin/camera", "json", schema, facts)
        lens = {"width_px": 8, "height_px": 6, "fx_px": 5, "fy_px": 5, "cx_px": 3, "cy_px": 2}
        wil = {"type": "camera", "source": "twin", "seq": 0, "t_s": 1.0, "camera_pose": None}
        body = {"format": "jpeg", "wil": {**wil, "intrinsics": {**lens, "distortion": []}}}
        writer.add_message(channel, 10**9, json.dumps(body).encode(), 10**9)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap


def test_a_disk_that_takes_nothing_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    record(tmp_path)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("wil_campaign.plugins.ros2.bags.recorded_bag.BagFile.finish", full)
    assert export(tmp_path, tmp_path / "flight.mcap") == 3
    assert "No space left on device" in capsys.readouterr().err
    assert not list(tmp_path.glob("*flight*"))


def test_two_sensors_with_the_same_topics_do_not_become_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (imu,) = (reading for reading in READINGS if reading.sensor == "imu")
    named = tuple(replace(imu, sensor=name) for name in ("left-imu", "left_imu"))
    monkeypatch.setattr(sys.modules[__name__], "READINGS", named)
    record(tmp_path, mode="sim")
    assert export(tmp_path, tmp_path / "flight.mcap") == 0
    assert len(decoded(tmp_path / "flight.mcap")["/left_imu/data"]) == 1
    said = capsys.readouterr().err
    assert "left out: 1 readings of /twin/left_imu, " in said
    assert "no topic of their own" in said
