"""The live feed of one run as messages of run.mcap: the same topics, schemas and encoding; pure."""

from dataclasses import dataclass, fields

import msgspec

from orchestrator.live_feed.feed_messages import (
    EventView,
    ImageView,
    MarginView,
    MixingView,
    RunView,
    VehicleView,
)
from orchestrator.recording.mcap.mcap_encode import (
    LOG,
    TRANSFORMS,
    Channel,
    Encoder,
    LogLevel,
    Message,
)
from orchestrator.recording.mcap.mcap_settings import RecordingSettings
from vehicles.readings import PoseReading, Source
from worlds.frames import Pose

RUN = Channel("/run", "wil.Run", "", "", "run")
"""Which run.mcap does not have: stage, vehicles, margins and mixtures, as consoles show them."""
POSE = "pose"
"""The topic of a vehicle's pose, beneath the vehicle's name."""
ALWAYS = (
    RUN,
    LOG,
    TRANSFORMS,
    *(Channel(f"/{name}/{POSE}", "foxglove.PoseInFrame", name, POSE) for name in ("real", "twin")),
)
"""What clients can ask for before anything flies."""
_LEVELS: dict[str, LogLevel] = {
    "stage": "info",
    "decisive": "error",
    "flag": "warning",
    "contact": "warning",
    "guard": "warning",
}
"""Of an event that is no STATUSTEXT, as run.mcap has it."""
_SEVERITIES: tuple[LogLevel, ...] = ("fatal", "fatal", "fatal", "error", "warning", "info", "info")
"""By MAV_SEVERITY of a STATUSTEXT; what follows is for debugging."""
_SOURCES: dict[str, Source] = {"real": "real", "twin": "twin", "mixed": "mixed"}


@dataclass(frozen=True, slots=True)
class RunState:
    """What `/run` says, as consoles show it: a RunView without what does not change."""

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


_STATE = tuple(field.name for field in fields(RunState))


class LiveMessages:
    """Encodes the live feed of one run. epoch_ns: UTC of its clock's zero."""

    def __init__(self, epoch_ns: int) -> None:
        self._encoder = Encoder(epoch_s=epoch_ns / 1e9, settings=RecordingSettings())

    def upright(self) -> Message:
        """Return the transform with which viewers draw north-east-down upright."""
        return self._encoder.upright()

    def ns(self, t_s: float) -> int:
        """Return a time of the run in nanoseconds since 1970."""
        return self._encoder.stamps.ns(t_s)

    def of(self, message: RunView | EventView | ImageView) -> list[Message]:
        """Return what a message of the live feed says, as messages of run.mcap."""
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

    def _pose(self, vehicle: VehicleView, view: RunView) -> list[Message]:
        """Return where a vehicle is: its pose and its transform; nothing while it is unknown."""
        source = _SOURCES.get(vehicle.name)
        position, attitude, t_s = vehicle.position_ned_m, vehicle.q_wxyz, vehicle.pose_t_s
        if source is None or position is None or attitude is None or t_s is None:
            return []
        reading = PoseReading(t_s, view.t_s, source, Pose(position, attitude), sensor=POSE)
        return self._encoder.encode(POSE, reading)

    def _run(self, view: RunView) -> Message:
        state = {name: msgspec.to_builtins(getattr(view, name)) for name in _STATE}
        return self._encoder.message(RUN, state, t_s=view.t_s, arrived_s=view.t_s)

    def _event(self, event: EventView) -> Message:
        """Return an event as a line of the run's log, with name and text as run.mcap has them."""
        if event.kind == "stage":
            return self._encoder.event(event.t_s, _LEVELS["stage"], "stage", event.word)
        if event.kind in {"guard", "operator", "vehicle"}:
            name = " ".join(filter(None, (event.kind, event.vehicle)))
            text = event.text or event.word
        else:
            name, text = event.word, event.text
        return self._encoder.event(event.t_s, _level(event), name, text)

    def _image(self, image: ImageView) -> Message:
        """Return an image as it is sent to consoles: smaller than that of run.mcap."""
        topic = f"/{image.source}/{image.sensor}"
        shown = {
            "frame_id": "twin" if image.source == "twin" else "real",
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
            Channel(topic, "foxglove.CompressedImage", image.source, image.sensor),
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
