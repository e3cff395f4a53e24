"""Encodes a run's live feed with the topics, schemas and encoding of run.mcap; pure."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import msgspec

from wil_campaign.orchestrator.recording.mcap.mcap_encode import (
    LOG,
    TRANSFORMS,
    LogLevel,
    McapChannel,
    McapEncoder,
    McapMessage,
    image_frame,
)
from wil_campaign.orchestrator.recording.mcap.mcap_settings import RecordingSettings
from wil_campaign.plugins.console.feed.feed_messages import (
    EventView,
    ImageView,
    MarginView,
    MixingView,
    RunView,
    VehicleView,
)
from wil_campaign.vehicles.readings import PoseReading, Source
from wil_campaign.worlds.camera import CameraMount
from wil_campaign.worlds.frames import Pose

RUN = McapChannel("/run", "wil.Run", "", "", "run")
"""Topic that run.mcap lacks: stage, vehicles, margins and mixtures, as consoles show them."""
POSE = "pose"
"""The topic of a vehicle's pose, beneath the vehicle's name."""
ALWAYS = (
    RUN,
    LOG,
    TRANSFORMS,
    *(
        McapChannel(f"/{name}/{POSE}", "foxglove.PoseInFrame", name, POSE)
        for name in ("real", "twin")
    ),
)
"""Topics that clients can subscribe to before a flight."""
_LEVELS: dict[str, LogLevel] = {
    "stage": "info",
    "decisive": "error",
    "flag": "warning",
    "contact": "warning",
    "guard": "warning",
}
"""Log level by kind of event, as in run.mcap; not for a STATUSTEXT."""
_SEVERITIES: tuple[LogLevel, ...] = ("fatal", "fatal", "fatal", "error", "warning", "info", "info")
"""Log level by MAV_SEVERITY of a STATUSTEXT; a higher one is debug."""
_SOURCES: dict[str, Source] = {"real": "real", "twin": "twin", "mixed": "mixed"}


@dataclass(frozen=True, slots=True)
class RunStateMessage:
    """The message of `/run`: a RunView without the parts that do not change."""

    name: str
    clock: str
    subject: str
    t_s: float
    stage: str
    verdict_so_far: str
    reason: str
    held: bool
    vehicles: tuple[VehicleView, ...]
    margins: tuple[MarginView, ...]
    mixings: tuple[MixingView, ...]


_STATE = tuple(field.name for field in fields(RunStateMessage))


class LiveMessages:
    """Encodes the live feed of one run. epoch_ns: UTC of its clock's zero. mounts: of cameras."""

    def __init__(self, epoch_ns: int, mounts: Mapping[str, CameraMount] | None = None) -> None:
        self._encoder = McapEncoder(
            epoch_s=epoch_ns / 1e9, settings=RecordingSettings(), mounts=mounts
        )

    def fixed_transforms(self) -> list[McapMessage]:
        """Return the transforms that do not change in the run."""
        return self._encoder.fixed_transforms()

    def ns(self, t_s: float) -> int:
        """Return a time of the run in nanoseconds since 1970."""
        return self._encoder.stamps.ns(t_s)

    def of(self, message: RunView | EventView | ImageView) -> list[McapMessage]:
        """Return a message of the live feed as messages of run.mcap."""
        match message:
            case RunView():
                poses = [
                    one for vehicle in message.vehicles for one in self._pose(vehicle, message)
                ]
                return [*poses, self._run(message)]
            case EventView():
                return [self._event(message)]
            case ImageView():
                return [self._image(message)]

    def _pose(self, vehicle: VehicleView, view: RunView) -> list[McapMessage]:
        """Return pose and transform of a vehicle; empty while they are unknown."""
        source = _SOURCES.get(vehicle.name)
        position, attitude, t_s = vehicle.position_ned_m, vehicle.q_wxyz, vehicle.pose_t_s
        if source is None or position is None or attitude is None or t_s is None:
            return []
        reading = PoseReading(t_s, view.t_s, source, Pose(position, attitude), sensor=POSE)
        return self._encoder.encode(POSE, reading)

    def _run(self, view: RunView) -> McapMessage:
        state = {name: msgspec.to_builtins(getattr(view, name)) for name in _STATE}
        return self._encoder.message(RUN, state, t_s=view.t_s, arrived_s=view.t_s)

    def _event(self, event: EventView) -> McapMessage:
        """Return an event as a message of the run's log, as in run.mcap."""
        if event.kind == "stage":
            return self._encoder.event(event.t_s, _LEVELS["stage"], "stage", event.word)
        if event.kind in {"guard", "operator", "vehicle"}:
            name = " ".join(filter(None, (event.kind, event.vehicle)))
            text = event.text or event.word
        else:
            name, text = event.word, event.text
        return self._encoder.event(event.t_s, _level(event), name, text)

    def _image(self, image: ImageView) -> McapMessage:
        """Return an image as sent to consoles: smaller than in run.mcap."""
        topic = f"/{image.source}/{image.sensor}"
        shown = {
            "frame_id": image_frame(image.source, image.sensor),
            "format": "jpeg",
            "wil": {
                "sensor": image.sensor,
                "type": "camera",
                "source": image.source,
                "seq": image.seq,
                "t_s": image.t_s,
                "arrived_s": image.arrived_s,
                "rendered": image.rendered,
                "exact": False,
            },
        }
        return self._encoder.message(
            McapChannel(topic, "foxglove.CompressedImage", image.source, image.sensor),
            shown,
            t_s=image.t_s,
            arrived_s=image.arrived_s,
            sequence=image.seq,
            data=image.jpeg,
        )


def _level(event: EventView) -> LogLevel:
    if event.severity is None:
        return _LEVELS.get(event.kind, "info")
    return _SEVERITIES[event.severity] if 0 <= event.severity < len(_SEVERITIES) else "debug"
