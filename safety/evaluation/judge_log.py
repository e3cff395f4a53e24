"""The log of a judge: every sample that it got, in a form that reads back exactly.

Judging a log gives the results of judging the flight, to the last bit: oracles are pure, and
numbers are not rounded. MessagePack arrays, one after the other (JSON would cost a run
without cameras three percent of its speed):

    ["wil/judged/2"]                                      the first row
    ["pose", t_s, vehicle, [n, e, d], [w, x, y, z], [vn, ve, vd]]
    ["state", t_s, vehicle, armed, mode, mode_name, landed, fault, battery_fraction, battery_v,
     estimator_fault, dead_reckoning]; only t_s and vehicle when nothing else has changed
    ["heard", t_s, vehicle]
    ["reference", t_s, vehicle, source, [n, e, d], [vn, ve, vd], [w, x, y, z] or nil]
    ["ground speed", t_s, vehicle, source, speed_m_s, accuracy_m_s or nil]
    ["heading", t_s, vehicle, source, turned_rad, accuracy_rad]
    ["report", t_s, vehicle, signal]                      a sample whose value is carried elsewhere
    ["doubt", t_s, vehicle, signal, source, reason]
    ["stage", t_s, stage, vehicle or nil]
    ["event", t_s, name]                                  of the world: objects move from then on
    ["actor", t_s, name, [n, e, d], [w, x, y, z], [vn, ve, vd]]   of an object that an actor flies
    ["tick", t_s]
    ["dropped out", t_s, vehicle]                         the flight continues without it
    ["fence", t_s, vehicle, fence]                        as safety/fence/fence_values.py writes it
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO, get_args

import msgpack  # type: ignore[import-untyped]  # ships no types

from wil_campaign.safety.evaluation.judge import Judge
from wil_campaign.safety.fence.fence_values import fence_of_plain, plain_fence
from wil_campaign.safety.model.samples import (
    DoubtSample,
    DropOutSample,
    FenceSample,
    GroundSpeedSample,
    HeadingSample,
    LinkSample,
    PoseSample,
    ReferenceSample,
    ReportSample,
    Stage,
    StageSample,
    StateSample,
)
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.scene.track import RunHistory

SCHEMA = "wil/judged/2"
_LARGEST = 1 << 20
"""Bytes of one sample; the text of a fault is the longest."""


class JudgeLogError(ValueError):
    """A file is no judge log, or is damaged; the message says where and why."""


@dataclass(frozen=True, slots=True)
class ClockTick:
    """The judge log's entry of passed time."""

    t_s: float


@dataclass(frozen=True, slots=True)
class LoggedWorldEvent:
    """The judge log's entry of an event on which objects of the world start to move."""

    t_s: float
    name: str


@dataclass(frozen=True, slots=True)
class ActorPose:
    """The judge log's entry of the pose of a world object that an actor flies (NED)."""

    t_s: float
    name: str
    pose: Pose
    velocity_ned_m_s: Vec3


LoggedSample = (
    PoseSample
    | ActorPose
    | StateSample
    | LinkSample
    | ReferenceSample
    | GroundSpeedSample
    | HeadingSample
    | ReportSample
    | DoubtSample
    | StageSample
    | DropOutSample
    | FenceSample
    | ClockTick
    | LoggedWorldEvent
)


_NAMES: dict[type[LoggedSample], str] = {
    ReferenceSample: "reference",
    GroundSpeedSample: "ground speed",
    HeadingSample: "heading",
    ReportSample: "report",
    LinkSample: "heard",
    DoubtSample: "doubt",
    StageSample: "stage",
    DropOutSample: "dropped out",
    ClockTick: "tick",
    LoggedWorldEvent: "event",
}
"""The row names of samples whose fields are written unchanged."""


class JudgeLogPacker:
    """Packs the judge's samples into judge log bytes; remembers each vehicle's last state."""

    def __init__(self) -> None:
        self._last_states: dict[str, tuple[Any, ...]] = {}
        self._pack = msgpack.Packer().pack

    def header(self) -> bytes:
        """Return the first bytes of a judge log."""
        packed: bytes = self._pack([SCHEMA])
        return packed

    def pack(self, sample: LoggedSample) -> bytes:
        """Return the judge log bytes of a sample."""
        packed: bytes = self._pack(self._row(sample))
        return packed

    def _row(self, sample: LoggedSample) -> tuple[Any, ...]:
        match sample:
            case PoseSample(t_s, vehicle, pose, velocity):
                return ("pose", t_s, vehicle, pose.position_ned_m, pose.q_wxyz, velocity)
            case ActorPose(t_s, name, pose, velocity):
                return ("actor", t_s, name, pose.position_ned_m, pose.q_wxyz, velocity)
            case StateSample():
                return self._state(sample)
            case ReferenceSample() | GroundSpeedSample() | HeadingSample() | ReportSample():
                return (_NAMES[type(sample)], *sample)
            case FenceSample(t_s, vehicle, fence):
                return ("fence", t_s, vehicle, plain_fence(fence))
            case _:
                return (_NAMES[type(sample)], *dataclasses.astuple(sample))

    def _state(self, sample: StateSample) -> tuple[Any, ...]:
        head = ("state", sample.t_s, sample.vehicle)
        fields = (
            sample.armed,
            sample.mode.value,
            sample.mode_name,
            sample.landed,
            sample.fault,
            sample.battery_fraction,
            sample.battery_v,
            sample.estimator_fault,
            sample.dead_reckoning,
        )
        if fields == self._last_states.get(sample.vehicle):
            return head
        self._last_states[sample.vehicle] = fields
        return head + fields


def read_judge_log(stream: BinaryIO) -> Iterator[LoggedSample]:
    """Yield the samples of a judge log; a truncated last one is left out.

    Raises JudgeLogError for a file that is no judge log, and for a row that is no sample.
    """
    states: dict[str, StateSample] = {}
    rows = msgpack.Unpacker(stream, max_buffer_size=_LARGEST)
    try:
        first = next(rows, None)
        if first != [SCHEMA]:
            raise JudgeLogError(f"it does not begin with {SCHEMA}")
        for row in rows:
            yield _sample(row, states)
    except (msgpack.UnpackException, ValueError, TypeError, KeyError) as error:
        if isinstance(error, JudgeLogError):
            raise
        message = f"it is damaged: there is no sample before byte {rows.tell()}"
        raise JudgeLogError(message) from error


def _sample(row: list[Any], states: dict[str, StateSample]) -> LoggedSample:
    kind, t_s, *rest = row
    if not isinstance(t_s, float) or kind not in _READERS:
        raise ValueError(f"it is {str(row)[:80]}")
    if kind == "state":
        return _state(t_s, rest, states)
    return _READERS[kind](t_s, *rest)


def _state(t_s: float, rest: list[Any], states: dict[str, StateSample]) -> StateSample:
    """Return the state sample of a judge log's row; a short row repeats the last state."""
    vehicle, *changed = rest
    if not changed:
        return dataclasses.replace(states[vehicle], t_s=t_s)
    armed, mode, *others = changed
    states[vehicle] = StateSample(t_s, vehicle, armed, FlightMode(mode), *others)
    return states[vehicle]


def _pose(
    t_s: float, vehicle: str, place: list[float], q: list[float], v: list[float]
) -> LoggedSample:
    (n, e, d), (w, x, y, z), (vn, ve, vd) = place, q, v
    return PoseSample(t_s, vehicle, Pose((n, e, d), (w, x, y, z)), (vn, ve, vd))


def _actor(
    t_s: float, name: str, place: list[float], q: list[float], v: list[float]
) -> LoggedSample:
    (n, e, d), (w, x, y, z), (vn, ve, vd) = place, q, v
    return ActorPose(t_s, name, Pose((n, e, d), (w, x, y, z)), (vn, ve, vd))


def _stage(name: str) -> Stage:
    for stage in get_args(Stage):
        if stage == name:
            return stage  # type: ignore[no-any-return]  # get_args is untyped
    raise ValueError(f"no stage {name!r}")


_READERS: dict[str, Callable[..., LoggedSample]] = {
    "pose": _pose,
    "actor": _actor,
    "state": StateSample,
    "heard": LinkSample,
    "report": ReportSample,
    "ground speed": GroundSpeedSample,
    "heading": HeadingSample,
    "reference": lambda t_s, vehicle, source, place, velocity, attitude=None: ReferenceSample(
        t_s, vehicle, source, tuple(place), tuple(velocity), attitude and tuple(attitude)
    ),
    "doubt": DoubtSample,
    "tick": ClockTick,
    "dropped out": DropOutSample,
    "stage": lambda t_s, stage, vehicle: StageSample(t_s, _stage(stage), vehicle),
    "event": LoggedWorldEvent,
    "fence": lambda t_s, vehicle, plain: FenceSample(t_s, vehicle, fence_of_plain(plain)),
}


@dataclass(frozen=True, slots=True)
class ReplayedJudgement:
    """How much of a run a judge log has. end_s: the run's end, None for a truncated log.

    stages: when each was entered first.
    """

    end_s: float | None
    stages: Mapping[Stage, float]


def judge_from_log(
    log: Iterable[LoggedSample], judge: Judge, events: RunHistory
) -> ReplayedJudgement:
    """Feed a judge log to a judge; return how much of the run it has.

    events: the history of the world, with which the judge's oracles were built.
    """
    reached: dict[Stage, float] = {}
    for sample in log:
        match sample:
            case PoseSample():
                judge.pose(sample)
            case ReferenceSample():
                judge.reference(sample)
            case GroundSpeedSample():
                judge.ground_speed(sample)
            case HeadingSample():
                judge.heading(sample)
            case ClockTick(t_s):
                judge.tick(t_s)
            case StageSample(t_s, stage):
                judge.stage(sample)
                reached.setdefault(stage, t_s)
            case LoggedWorldEvent(t_s, name):
                events[name] = t_s
            case ActorPose(t_s, name, pose, velocity):
                events.add_pose(name, t_s, pose, velocity)
            case _:
                _feed(judge, sample)
    return ReplayedJudgement(reached.get("end"), reached)


def _feed(
    judge: Judge,
    sample: StateSample | LinkSample | ReportSample | DoubtSample | DropOutSample | FenceSample,
) -> None:
    match sample:
        case StateSample():
            judge.state(sample)
        case LinkSample():
            judge.received(sample)
        case ReportSample():
            judge.report(sample)
        case DoubtSample():
            judge.doubt(sample)
        case DropOutSample():
            judge.drop_out(sample)
        case FenceSample():
            judge.fence(sample)
