"""run.mcap: what goes in comes out, for us and for others."""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.reader import make_reader

from tests.orchestrator.mcap_runs import (
    INF,
    INTRINSICS,
    MOUNT,
    NAN,
    PROVENANCE,
    RNG,
    assert_same,
    camera,
    read,
    recorder,
)
from wil_campaign.orchestrator.recording.mcap.mcap_bodies import calibration_body
from wil_campaign.orchestrator.recording.mcap.mcap_encode import McapEncoder
from wil_campaign.orchestrator.recording.mcap.mcap_settings import (
    LOSSLESS,
    ImageSettings,
    RecordingSettings,
)
from wil_campaign.orchestrator.recording.recording_facts import mounts_in
from wil_campaign.plugins.python.mcap_reader import (
    RecordedEvent,
    RecordedProvenance,
    RecordedReading,
)
from wil_campaign.recipes.pipeline.mixture import StageTime
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    PoseReading,
    RangefinderReading,
    Reading,
    Source,
    sensor_type_of,
)
from wil_campaign.vehicles.readings.messages import encode_message, number_from_json, pose_from_json
from wil_campaign.worlds.camera import CameraMount
from wil_campaign.worlds.frames import Pose, Vec3

SOURCES: tuple[Source, ...] = ("real", "twin", "mixed")

READINGS: tuple[Reading, ...] = (
    camera(),
    replace(camera(1, "twin"), depth_m=None, object_ids=None, camera_pose=None),
    DepthReading(
        0.1,
        0.2,
        1,
        "twin",
        camera().depth_m,  # type: ignore[arg-type]  # it has depth
        INTRINSICS,
        camera().object_ids,
        Pose((9.0, 8.0, -7.0)),
        mount=MOUNT,
    ),
    LidarScanReading(
        1 / 3,
        0.5,
        7,
        "real",
        np.array([1.1, INF, NAN, -INF, 3.3], np.float32),
        -0.7,
        0.1,
        0.15,
        12.0,
        np.array([1, 0, 0, 0, 255], np.uint8),
        MOUNT,
    ),
    LidarScanReading(0.1, 0.2, 0, "twin", np.zeros(0, np.float32), 0.0, 0.1, 0.1, 9.0),
    LidarPointsReading(
        0.1,
        0.2,
        3,
        "twin",
        RNG.normal(0, 9, (50, 3)).astype(np.float32),
        RNG.integers(0, 9, 50, np.uint8),
        MOUNT,
    ),
    LidarPointsReading(0.1, 0.2, 4, "twin", np.zeros((0, 3), np.float32)),
    RangefinderReading(0.1, 0.2, 5, "real", INF, 0.1, 12.0, MOUNT),
    RangefinderReading(0.2, 0.3, 6, "real", 2.345678901234567, 0.1, 12.0, MOUNT),
    GpsReading(0.1, 0.2, 6, "real", 47.1234567890123, 8.5, 488.1, (0.1, NAN, 0.3), 2.1, 4.2, 3, 9),
    PoseReading(0.1, 0.2, "real", Pose.of(1.0, 2.0, 3.0, yaw_rad=0.4), (0.1, 0.2, 0.3), seq=9),
    PoseReading(0.1, 0.2, "twin", Pose.of(1.0, 2.0, 3.0)),
    ImuReading(0.1, 0.2, 8, "mixed", (0.1, 0.2, -9.8), (NAN, -INF, 0.3)),
    MicrophoneReading(
        0.1, 0.2, 2, "real", RNG.integers(-32768, 32767, 512).astype(np.int16), 16_000, 28.28
    ),
)


@pytest.mark.parametrize("reading", READINGS, ids=sensor_type_of)
@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_every_reading_comes_back_to_the_bit(
    tmp_path: Path, reading: Reading, compression: Literal["zstd", "lz4", "none"]
) -> None:
    path = tmp_path / "run.mcap"
    with recorder(path, settings=replace(LOSSLESS, compression=compression)) as run:
        run.reading("thing", reading)
    found, recording = read(path)
    (one,) = found
    assert isinstance(one, RecordedReading)
    assert (one.sensor, one.exact) == ("thing", True)
    assert_same(reading, one.reading)
    assert recording.end is not None
    assert recording.end.whole
    assert recording.counts == {"written": "2", "failed": "0"}
    assert recording.facts["epoch_ns"] == "1767225600000000000"


@pytest.mark.parametrize(("form", "exact"), [("jpeg", False), ("png", True), ("raw", True)])
def test_images_in_each_form(
    tmp_path: Path, form: Literal["jpeg", "png", "raw"], *, exact: bool
) -> None:
    path = tmp_path / "run.mcap"
    smooth = replace(
        camera(), image_bgr=np.tile(np.arange(0, 192, 4, dtype=np.uint8)[:, None, None], (1, 64, 3))
    )
    with recorder(path, settings=RecordingSettings(real=ImageSettings(form))) as run:
        run.reading("camera", smooth)
    (one,), _ = read(path)
    assert isinstance(one, RecordedReading)
    assert isinstance(one.reading, CameraReading)
    assert one.exact is exact
    assert one.reading.depth_m is None
    off = np.abs(one.reading.image_bgr.astype(int) - smooth.image_bgr.astype(int)).max()
    assert off == 0 if exact else off <= 8
    with pytest.raises(ValueError, match="read-only"):
        one.reading.image_bgr[0, 0, 0] = 1


def test_only_the_vehicles_own_poses_place_them() -> None:
    encoder = McapEncoder(epoch_s=0.0, settings=RecordingSettings())
    pose = PoseReading(0.1, 0.2, "real", Pose.of(1.0, 2.0, 3.0))
    topics = {
        source: [one.channel.topic for one in encoder.encode("pose", replace(pose, source=source))]
        for source in SOURCES
    }
    assert topics == {
        "real": ["/real/pose", "/tf"],
        "twin": ["/twin/pose", "/tf"],
        "mixed": ["/mixed/pose"],
    }


@pytest.mark.parametrize("source", ["real", "mixed"])
@pytest.mark.parametrize("stabilized", [False, True])
def test_an_image_is_drawn_where_its_camera_looks(source: Source, *, stabilized: bool) -> None:
    mount = CameraMount(Pose.of(0.1, 0.02, 0.05, yaw_rad=0.3, pitch_rad=-0.4), stabilized)
    encoder = McapEncoder(epoch_s=0.0, settings=LOSSLESS, mounts={"real/camera": mount})
    body = Pose.of(5.0, -2.0, 3.0, roll_rad=0.2, pitch_rad=0.1, yaw_rad=1.0)
    pose = encoder.encode("pose", PoseReading(0.1, 0.2, "real", body))
    images = encoder.encode("camera", replace(camera(0, source), sensor="camera"))
    documents = [json.loads(one.data) for one in (*encoder.fixed_transforms(), *pose)]
    transforms = {
        document["child_frame_id"]: document
        for document in documents
        if "child_frame_id" in document
    }
    shown = {image.channel.topic: json.loads(image.data) for image in images}
    assert {one["frame_id"] for one in shown.values()} == {"real/camera"}

    def seen_from(frame: str, point_ned_m: Vec3) -> Vec3:
        if frame == "ned":
            return point_ned_m
        one = transforms[frame]
        placed = pose_from_json({"position": one["translation"], "orientation": one["rotation"]})
        return placed.to_local(seen_from(one["parent_frame_id"], point_ned_m))

    looking = mount.camera_pose(body)
    for there in ((4.0, 0.7, -0.3), (9.0, -2.0, 1.0)):
        point = seen_from("real/camera", looking.to_parent(there))
        matrix = np.reshape(shown[f"/{source}/camera/calibration"]["K"], (3, 3))
        u_px, v_px, scale = matrix @ point
        assert (u_px / scale, v_px / scale) == pytest.approx(INTRINSICS.project(there))


@pytest.mark.parametrize(
    ("count", "model"),
    [(0, ""), (4, "plumb_bob"), (5, "plumb_bob"), (8, "rational_polynomial")],
)
def test_a_calibration_names_its_model_of_distortion(count: int, model: str) -> None:
    _, fields, _ = calibration_body(replace(INTRINSICS, distortion=(0.01,) * count))
    assert fields["distortion_model"] == model


def test_the_mounts_of_the_cameras_are_facts_of_a_recording() -> None:
    mount = CameraMount(Pose.of(0.1, 0.0, 0.05, yaw_rad=0.3), stabilized=True)
    facts = {"mounts": json.dumps({"real/camera": asdict(mount)})}
    assert mounts_in(facts) == {"real/camera": mount}
    assert mounts_in({}) == {}


def test_images_of_an_unwanted_source_are_not_recorded(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with recorder(path, settings=RecordingSettings(twin=ImageSettings("none"))) as run:
        run.reading("camera", camera(1, "twin"))
        run.reading("camera", camera(1, "real"))
    found, _ = read(path)
    assert [one.reading.source for one in found if isinstance(one, RecordedReading)] == ["real"]


def test_provenance_and_log_lines_come_back(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with recorder(path) as run:
        run.mixed("camera", camera(3, "mixed"), PROVENANCE, now_s=0.4)
        run.mixed("camera", None, PROVENANCE, now_s=0.5)
        run.event(0.75, "warning", "contact", "touched NaN gate, Infinity")
    (mixed, first, second, event), _ = read(path)
    assert isinstance(mixed, RecordedReading)
    assert mixed.reading.source == "mixed"
    assert isinstance(first, RecordedProvenance)
    assert isinstance(second, RecordedProvenance)
    assert first.fields == {
        "real_seq": 4,
        "real_t_s": 1.0 / 3.0,
        "twin_seq": None,
        "twin_t_s": None,
        "skew_ms": None,
        "latency_ms": 12.5,
        "alignment": "interpolated",
        "dropped": None,
        "detail": "",
        "stages": [
            {"step": "resize", "duration_s": 0.001},
            {"step": "overlay", "duration_s": 0.002},
        ],
        "registration_error_px": None,
        "registration_bound_px": None,
        "mixed_s": None,
        "given_real_seq": None,
        "given_twin_seq": None,
    }
    assert second.log_ns - first.log_ns == 100_000_000
    assert event == RecordedEvent(
        1767225600_750_000_000, 3, "contact", "touched NaN gate, Infinity"
    )


@given(
    st.recursive(
        st.floats() | st.integers(-9, 9) | st.text() | st.none() | st.booleans(),
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
        max_leaves=12,
    ),
    st.none() | st.binary(max_size=40),
)
@example(["\x00inf", "\x00-inf", float("inf")], None)
def test_json_is_json_and_exact_but_for_not_a_number(value: Any, data: bytes | None) -> None:
    def refuse(constant: str) -> float:
        raise AssertionError(f"{constant} is no JSON")

    back = json.loads(encode_message({"value": value}, data), parse_constant=refuse)
    assert ("data" in back) == (data is not None)
    assert repr(back["value"]) == repr(value).replace("nan", "None") or "nan" in repr(value).lower()
    if isinstance(value, float):
        assert repr(number_from_json(back["value"])) == repr(value)


class TestForOthers:
    """The official reader opens what we write."""

    @pytest.fixture
    def path(self, tmp_path: Path) -> Path:
        path = tmp_path / "run.mcap"
        with recorder(path, settings=RecordingSettings()) as run:
            for reading in READINGS:
                run.reading(sensor_type_of(reading), reading)
            run.mixed("camera", camera(2, "mixed"), PROVENANCE, now_s=0.5)
            run.event(0.6, "info", "stage", "takeoff")
        return path

    def test_topics_schemas_and_times(self, path: Path) -> None:
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            found = [
                (channel.topic, schema.name, message)
                for schema, channel, message in reader.iter_messages(log_time_order=False)
                if schema is not None
            ]
            summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(found)
        kinds = {topic: name for topic, name, _ in found}
        assert kinds["/real/camera"] == "foxglove.CompressedImage"
        assert kinds["/real/camera/calibration"] == "foxglove.CameraCalibration"
        assert kinds["/real/lidar"] == "foxglove.LaserScan"
        assert kinds["/twin/lidar_points"] == "foxglove.PointCloud"
        assert kinds["/real/gps"] == "foxglove.LocationFix"
        assert kinds["/real/pose"] == "foxglove.PoseInFrame"
        assert kinds["/real/microphone"] == "foxglove.RawAudio"
        assert kinds["/mixed/camera/provenance"] == "wil.Provenance"
        assert kinds["/log"] == "foxglove.Log"
        assert kinds["/tf"] == "foxglove.FrameTransform"
        assert kinds["/twin/depth"] == "foxglove.RawImage"
        scan = next(message for topic, _, message in found if topic == "/real/lidar")
        assert scan.log_time == 1767225600_500_000_000
        assert scan.publish_time == 1767225600_333_333_333
        assert scan.sequence == 7

    def test_messages_have_what_their_schemas_say(self, path: Path) -> None:
        with path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages():
                assert schema is not None
                assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
                document, text = json.loads(message.data), json.loads(schema.data)
                assert text["title"] == schema.name
                assert set(document) == set(text["properties"]), channel.topic
                _conforms(document, text)

    def test_points_are_packed_as_their_fields_say(self, path: Path) -> None:
        with path.open("rb") as file:
            messages = make_reader(file).iter_messages(topics=["/twin/lidar_points"])
            document = json.loads(next(iter(messages))[2].data)
        assert [(one["name"], one["offset"], one["type"]) for one in document["fields"]] == [
            ("x", 0, 7),
            ("y", 4, 7),
            ("z", 8, 7),
            ("object_id", 12, 1),
        ]
        assert document["point_stride"] == 13


def _conforms(value: Any, schema: dict[str, Any]) -> None:
    """Check a value against the part of JSON schema that our schemas use."""
    kinds: dict[Any, Any] = {
        "object": dict,
        "array": list,
        "string": str,
        "integer": int,
        "boolean": bool,
    }
    kind = schema.get("type")
    if value is None or kind is None:
        return
    assert isinstance(value, kinds.get(kind, (int, float))), (value, schema)
    if kind == "array":
        for one in value:
            _conforms(one, schema["items"])
    if kind == "object":
        for name, part in schema.get("properties", {}).items():
            _conforms(value[name], part)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((48, 64), np.uint8),
        np.zeros((0, 0, 3), np.uint8),
        np.zeros((48, 64, 3), np.float32),
        np.zeros((2, 3, 4, 5), np.uint16),
    ],
    ids=lambda image: f"{image.dtype} {image.shape}",
)
def test_a_picture_of_a_wrong_shape_is_kept_as_it_was(
    tmp_path: Path, image: "np.ndarray[Any, Any]"
) -> None:
    path = tmp_path / "run.mcap"
    bad = replace(camera(), image_bgr=image, depth_m=None, object_ids=None)
    with recorder(path, settings=RecordingSettings()) as run:
        run.reading("camera", bad)
    (one,), _ = read(path)
    assert isinstance(one, RecordedReading)
    assert_same(bad, one.reading)


@dataclass(frozen=True, slots=True)
class Other:
    """A provenance of another shape: the recorder takes any frozen dataclass."""

    pairs: tuple[tuple[float, float], ...]
    inner: StageTime | None
    stale: bool


def test_any_frozen_dataclass_can_be_a_provenance(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with recorder(path) as run:
        run.mixed("lidar", None, Other(((1.0, INF),), StageTime("x", 0.5), stale=True), now_s=1.0)
    (one,), _ = read(path)
    assert isinstance(one, RecordedProvenance)
    assert one.fields == {
        "pairs": [[1.0, INF]],
        "inner": {"step": "x", "duration_s": 0.5},
        "stale": True,
    }
    with path.open("rb") as file:
        schema = next(
            schema
            for schema, channel, _ in make_reader(file).iter_messages()
            if channel.topic == "/mixed/lidar/provenance"
        )
    assert schema is not None
    properties = json.loads(schema.data)["properties"]
    assert properties["pairs"]["items"]["items"] == {"type": "number"}
    assert properties["inner"]["properties"]["step"] == {"type": "string"}
    assert properties["stale"] == {"type": "boolean"}
