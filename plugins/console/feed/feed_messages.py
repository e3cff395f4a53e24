"""Messages of the live feed, from the process of a run to consoles: one per datagram.

World frame, NED, metres, radians, seconds on the run clock. An unknown number is None; one that is
not finite is sent unchanged, because a console has to show it.
"""

from typing import Any, Self

import msgspec

from wil_campaign.foundation.processes.codec import MessageCodec, ProcessMessage
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.worlds.frames import Quat, Vec3
from wil_campaign.worlds.scene.track import RunHistory

LONGEST_DATAGRAM_BYTES = 200_000
"""Below the default send buffer of a socket on Linux (net.core.wmem_default, 212,992)."""


class VehicleView(msgspec.Struct, frozen=True):
    """One vehicle as the live feed shows it.

    silent_s: time since its last message. battery_fraction: 0 to 1. setpoint_kind: position,
    velocity, or empty. faults: of its estimator, in the firmware's words. note: of its autonomy.
    pose_t_s: time of position_ned_m and q_wxyz.
    """

    name: str
    armed: bool
    mode: str
    landed: str
    link_up: bool
    failsafe: bool
    silent_s: float | None = None
    battery_fraction: float | None = None
    battery_v: float | None = None
    faults: tuple[str, ...] = ()
    position_ned_m: Vec3 | None = None
    q_wxyz: Quat | None = None
    velocity_ned_m_s: Vec3 | None = None
    estimate_ned_m: Vec3 | None = None
    setpoint_kind: str = ""
    setpoint: Vec3 | None = None
    note: str = ""
    pose_t_s: float | None = None


class MarginView(msgspec.Struct, frozen=True):
    """One oracle's value so far in the live feed. limits: low and high; None where open.

    has_failed: FAIL, whatever follows; without it the verdict FAIL means "not yet".
    """

    name: str
    vehicle: str
    required: bool
    verdict: str
    actual: float | None
    limits: tuple[float | None, float | None]
    unit: str
    margin: float | None
    detail: str
    has_failed: bool = False

    @classmethod
    def of(cls, result: OracleResult, *, has_failed: bool) -> Self:
        """Return an oracle's result so far."""
        limit = result.limit
        return cls(
            name=result.name,
            vehicle=result.vehicle,
            required=result.required,
            verdict=result.verdict,
            actual=result.actual,
            limits=limit if isinstance(limit, tuple) else (None, limit),
            unit=result.unit,
            margin=result.margin,
            detail=result.detail,
            has_failed=has_failed,
        )


class MixingView(msgspec.Struct, frozen=True):
    """The newest figures of one mixture in the live feed."""

    name: str
    rate_hz: float | None
    skew_ms: float | None
    latency_ms: float | None
    registration_error_px: float | None
    missed: int


class ObjectPose(ProcessMessage, frozen=True):
    """Pose of a world object that a vehicle flies: NED metres, body to NED."""

    position_ned_m: Vec3
    q_wxyz: Quat


def flown_poses(history: RunHistory, t_s: float) -> dict[str, ObjectPose]:
    """Return the known poses of a run's flown objects at a time."""
    poses = {name: track.pose_at(t_s) for name, track in history.tracks.items()}
    return {
        name: ObjectPose(pose.position_ned_m, pose.q_wxyz)
        for name, pose in poses.items()
        if pose is not None
    }


class RunView(ProcessMessage, frozen=True):
    """The state of a run as the live feed shows it.

    run: its folder; name: case, mode and repetition. entered_s: when each stage was reached;
    events: times of the events that move the world's objects. fences: by vehicle, as plain values.
    reason: of the verdict so far. flown: poses of world objects that vehicles fly.
    """

    run: str
    name: str
    clock: str
    subject: str
    t_s: float
    stage: str
    entered_s: dict[str, float]
    events: dict[str, float]
    verdict_so_far: str
    reason: str
    held: bool
    vehicles: tuple[VehicleView, ...]
    margins: tuple[MarginView, ...]
    mixings: tuple[MixingView, ...]
    fences: dict[str, Any]
    flown: dict[str, ObjectPose] = msgspec.field(default_factory=dict)


class EventView(ProcessMessage, frozen=True):
    """An event of a run in the live feed. number: counts up by one, so that gaps are visible.

    kind: stage, decisive, contact, flag, guard, operator or vehicle; word: the subtype.
    severity: of a STATUSTEXT, its MAV_SEVERITY.
    """

    run: str
    number: int
    t_s: float
    kind: str
    word: str
    vehicle: str
    text: str
    severity: int | None = None


class FactsView(ProcessMessage, frozen=True):
    """The facts of a run in the live feed, as run.mcap has them: world, campaign, case, mode.

    epoch_ns is among them: UTC of the run clock's zero, nanoseconds since 1970; and clock: virtual,
    wall or scaled.
    """

    run: str
    facts: dict[str, str]


class ImageView(ProcessMessage, frozen=True):
    """An image of a run in the live feed. name: real, twin or mixed; age_s: when it was sent.

    source, sensor, arrived_s: of the reading that it shows. alone: why a mixture lacks the twin;
    empty where it does not.
    """

    run: str
    name: str
    seq: int
    t_s: float
    age_s: float
    width_px: int
    height_px: int
    rendered: bool
    jpeg: bytes
    source: str = ""
    sensor: str = ""
    arrived_s: float = 0.0
    alone: str = ""


FeedMessage = RunView | EventView | FactsView | ImageView
feed_codec: MessageCodec[FeedMessage] = MessageCodec(FeedMessage)
