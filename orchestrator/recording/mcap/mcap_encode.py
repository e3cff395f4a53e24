"""Encodes readings as messages of run.mcap; its only state is the written camera models."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from wil_campaign.orchestrator.recording.mcap.mcap_bodies import (
    Body,
    calibration_body,
    camera_body,
    depth_body,
    drawing_body,
    raw_image_body,
    reading_body,
)
from wil_campaign.orchestrator.recording.mcap.mcap_settings import ImageSettings, RecordingSettings
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    PoseReading,
    Reading,
    sensor_type_of,
)
from wil_campaign.vehicles.readings.kinds import traits_of
from wil_campaign.vehicles.readings.messages import Json, encode_message, pose_to_json
from wil_campaign.worlds.camera import CameraMount, Intrinsics
from wil_campaign.worlds.frames import Pose

MAP_FRAME, NED_FRAME = "map", "ned"
"""East-north-up, which Foxglove draws upright, and the north-east-down of all our values."""
_UPRIGHT = Pose((0.0, 0.0, 0.0), (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0))
"""North-east-down in east-north-up."""
_OPTICAL = Pose((0.0, 0.0, 0.0), (0.5, 0.5, 0.5, 0.5))
"""The frame of an image (x right, y down, z into the image) in the camera's FRD frame."""

_LAST_NS = 2**63 - 1


@dataclass(frozen=True, slots=True)
class McapChannel:
    """An MCAP channel: one topic.

    part: "reading", or "drawing" of one that is drawn again; or what accompanies it: "depth",
    "ids", "calibration", "provenance", "transform", "event".
    """

    topic: str
    schema: str
    source: str
    sensor: str
    part: str = "reading"


@dataclass(frozen=True, slots=True)
class McapMessage:
    """An encoded MCAP message; nanoseconds since 1970; publish_ns: when it was sampled."""

    channel: McapChannel
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


TRANSFORMS = McapChannel("/tf", "foxglove.FrameTransform", "", "", "transform")
LOG = McapChannel("/log", "foxglove.Log", "", "", "event")
PERCEIVED = "perceived"
"""Name of the log's line with the topic of the images that the judged autonomy perceives."""
LogLevel = Literal["debug", "info", "warning", "error", "fatal"]
_LEVELS: Mapping[LogLevel, int] = {"debug": 1, "info": 2, "warning": 3, "error": 4, "fatal": 5}
"""foxglove.Log."""


class McapStamps:
    """Converts the run clock to an MCAP message's nanoseconds since 1970, exactly."""

    def __init__(self, epoch_s: float) -> None:
        self.epoch_ns = round(epoch_s * 1e9)

    def ns(self, t_s: float) -> int:
        """Return the MCAP stamp of a time; an invalid one gives the start of the run."""
        if not math.isfinite(t_s):
            return self.epoch_ns
        return min(max(0, self.epoch_ns + round(t_s * 1e9)), _LAST_NS)

    def time(self, t_s: float) -> dict[str, int]:
        """Return the stamp in the form of Foxglove's messages."""
        seconds, nanoseconds = divmod(self.ns(t_s), 1_000_000_000)
        return {"sec": seconds, "nsec": nanoseconds}


class McapEncoder:
    """Encodes readings as MCAP messages, in the order in which they are to be written.

    mounts: of cameras and depth cameras, by their frame, as "real/camera".
    """

    def __init__(
        self,
        *,
        epoch_s: float,
        settings: RecordingSettings,
        mounts: Mapping[str, CameraMount] | None = None,
    ) -> None:
        self.stamps = McapStamps(epoch_s)
        self._mounts = dict(mounts or {})
        self._image_settings: Mapping[str, ImageSettings] = {
            "real": settings.real,
            "twin": settings.twin,
            "mixed": settings.mixed,
        }
        self._known_intrinsics: dict[tuple[str, str], Intrinsics] = {}

    def encode(self, sensor: str, reading: Reading) -> list[McapMessage]:
        """Return a reading's encoded messages; parts of an image come before the image."""
        if isinstance(reading, CameraReading):
            return self._camera(sensor, reading)
        if isinstance(reading, DepthReading):
            parts = self._ids(sensor, reading, wanted=True)
            body = depth_body(reading, [part.channel.part for part in parts])
            calibration = self._calibration(sensor, reading)
            return [*calibration, *parts, self._message(sensor, reading, body)]
        message = self._message(sensor, reading, reading_body(reading))
        # A mixed pose is what the autonomy perceives: it does not place the vehicle.
        if isinstance(reading, PoseReading) and reading.source != "mixed":
            return [message, *self._transforms(reading)]
        return [message]

    def _camera(self, sensor: str, reading: CameraReading) -> list[McapMessage]:
        images = self._image_settings[reading.source]
        if images.format == "none":
            return []
        if reading.drawing is not None and not images.keeps_drawn:
            body = drawing_body(reading, reading.drawing)
            drawing = self._message(sensor, reading, body, "drawing")
            return [*self._calibration(sensor, reading), drawing]
        parts = self._ids(sensor, reading, wanted=images.object_ids)
        if images.depth and reading.depth_m is not None:
            parts.append(
                self._message(sensor, reading, raw_image_body(reading.depth_m, {}), "depth")
            )
        body = camera_body(reading, images, [part.channel.part for part in parts])
        calibration = self._calibration(sensor, reading)
        return [*calibration, *parts, self._message(sensor, reading, body)]

    def _ids(
        self, sensor: str, reading: CameraReading | DepthReading, *, wanted: bool
    ) -> list[McapMessage]:
        if not wanted or reading.object_ids is None:
            return []
        return [self._message(sensor, reading, raw_image_body(reading.object_ids, {}), "ids")]

    def _calibration(self, sensor: str, reading: CameraReading | DepthReading) -> list[McapMessage]:
        key = (reading.source, sensor)
        if self._known_intrinsics.get(key) == reading.intrinsics:
            return []
        self._known_intrinsics[key] = reading.intrinsics
        return [self._message(sensor, reading, calibration_body(reading.intrinsics), "calibration")]

    def _transforms(self, reading: PoseReading) -> list[McapMessage]:
        """Return the transforms of a vehicle's body and of its stabilized cameras."""
        body = _body_frame(reading)
        poses = {body: reading.pose}
        for frame, mount in self._mounts.items():
            if mount.stabilized and frame.startswith(f"{body}/"):
                poses[frame] = mount.camera_pose(reading.pose).compose(_OPTICAL)
        return [
            self._transform(
                NED_FRAME,
                frame,
                pose,
                t_s=reading.t_s,
                arrived_s=reading.arrived_s,
                sequence=reading.seq,
            )
            for frame, pose in poses.items()
        ]

    def fixed_transforms(self) -> list[McapMessage]:
        """Return the transforms that do not change in a run: `map` to `ned`, body to cameras."""
        cameras = [
            self._transform(frame.partition("/")[0], frame, mount.pose.compose(_OPTICAL))
            for frame, mount in self._mounts.items()
            if not mount.stabilized
        ]
        return [self._transform(MAP_FRAME, NED_FRAME, _UPRIGHT), *cameras]

    def _transform(
        self,
        parent: str,
        child: str,
        pose: Pose,
        *,
        t_s: float = 0.0,
        arrived_s: float = 0.0,
        sequence: int = 0,
    ) -> McapMessage:
        placed = pose_to_json(pose)
        return self.message(
            TRANSFORMS,
            {
                "parent_frame_id": parent,
                "child_frame_id": child,
                "translation": placed["position"],
                "rotation": placed["orientation"],
            },
            t_s=t_s,
            arrived_s=arrived_s,
            sequence=sequence,
        )

    def event(self, t_s: float, level: LogLevel, name: str, text: str) -> McapMessage:
        """Return an encoded line of the run's log."""
        fields = {"level": _LEVELS[level], "message": text, "name": name, "file": "", "line": 0}
        return self.message(LOG, fields, t_s=t_s, arrived_s=t_s)

    def message(
        self,
        channel: McapChannel,
        fields: dict[str, Json],
        *,
        t_s: float,
        arrived_s: float,
        sequence: int = 0,
        data: bytes | None = None,
    ) -> McapMessage:
        """Return an encoded message whose fields follow its time stamp."""
        document = {"timestamp": self.stamps.time(t_s), **fields}
        return McapMessage(
            channel,
            self.stamps.ns(arrived_s),
            self.stamps.ns(t_s),
            sequence & 0xFFFFFFFF,
            encode_message(document, data),
        )

    def _message(
        self, sensor: str, reading: Reading, body: Body, part: str = "reading"
    ) -> McapMessage:
        schema, fields, data = body
        topic = f"/{reading.source}/{sensor}" + ("" if part == "reading" else f"/{part}")
        return self.message(
            McapChannel(topic, schema, reading.source, sensor, part),
            {
                "frame_id": _frame(sensor, reading),
                **fields,
                "wil": {**_common(reading), **fields.get("wil", {})},
            },
            t_s=reading.t_s,
            arrived_s=reading.arrived_s,
            sequence=reading.seq,
            data=data,
        )


def _frame(sensor: str, reading: Reading) -> str:
    """Return the frame id of a reading: of an image the camera's optical frame."""
    if traits_of(type(reading)).in_world:
        return NED_FRAME
    if isinstance(reading, CameraReading | DepthReading):
        return image_frame(reading.source, reading.sensor or sensor)
    return _body_frame(reading)


def image_frame(source: str, sensor: str) -> str:
    """Return the frame id of a camera's images; a mixed one is in the real camera's frame."""
    return f"{'twin' if source == 'twin' else 'real'}/{sensor}"


def _body_frame(reading: Reading) -> str:
    """Return the frame id of a vehicle's body; a mixed reading is in the real one's frame."""
    return "twin" if reading.source == "twin" else "real"


def _common(reading: Reading) -> dict[str, Json]:
    named = {"sensor": reading.sensor} if reading.sensor else {}
    return {
        **named,
        "type": sensor_type_of(reading),
        "source": reading.source,
        "seq": reading.seq,
        "t_s": reading.t_s,
        "arrived_s": reading.arrived_s,
    }
