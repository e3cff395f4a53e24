"""Flights that must fail, each with a seeded fault of a signal that it is judged by.

`python -m tests.faults.signals FIRST COUNT FOLDER` prints one JSON object for each flight. None may
be a PASS, but where `lone` is set and the fault is one that no second source could show.
"""

import json
import math
import struct
import sys
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from campaigns.expansion.expansion import Options, load_campaign
from orchestrator.run.flight.run import fly
from orchestrator.run.vehicles.pair import Pair
from orchestrator.state.run_setup import RunOrder, RunSetup
from orchestrator.state.run_state import RunState, Stage
from safety.guard.core.operator_command import OperatorCommand
from tests.faults.motion_capture import Alter, captured
from tests.faults.relay import Change, Position, relay
from tests.orchestrator.wall import write_wall
from vehicles.mavlink.framing import Frame, with_payload
from vehicles.readings import PoseReading
from worlds.frames import Pose, add

Kind = Literal["stop", "freeze", "delay", "bias", "jump", "nan", "duplicate", "clock step"]
KINDS: tuple[Kind, ...] = get_args(Kind)

Cause = Literal["wall", "table", "area", "altitude", "slow"]
MISSIONS: dict[Cause, tuple[str, ...]] = {
    "wall": (),
    "table": (
        "world.objects.wall.shape={box: {size_m: [3, 3, 0.6]}}",
        "world.objects.wall.pose={north_m: 6.5, east_m: 0, up_m: 0.3}",
    ),
    "area": (
        "world.objects.wall.pose.north_m=30",
        "oracles.area={keep: {box: {north_m: [-2, 4], east_m: [-2, 2], up_m: [-1, 3]}}}",
    ),
    "altitude": ("world.objects.wall.pose.north_m=30", "oracles.altitude={max_m: 1.0}"),
    "slow": ("world.objects.wall.pose.north_m=30", "oracles.time_limit={limit_s: 4}"),
}
"""Why each flight fails when nothing disturbs it."""
_STAGES: tuple[Stage, ...] = ("takeoff", "at_height", "goal", "land")
_MESSAGES = (
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
)


@dataclass(frozen=True, slots=True)
class SignalFault:
    """A fault of one source. message_id: of MAVLink; None for motion capture.

    lone: whether nothing else knows where the vehicle is, as outdoors. offset_m: of a bias or a
    jump; step_s: of a delay or a clock, negative for back.
    """

    seed: int
    cause: Cause
    kind: Kind
    message_id: int | None
    lone: bool
    stage: Stage
    after_s: float
    offset_m: tuple[float, float, float]
    step_s: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a flight came to, and whether that may be."""

    fault: SignalFault
    verdict: str
    reason: str
    wrong: bool


def draw(seed: int) -> SignalFault:
    """Return the fault of a seed."""
    rng = np.random.default_rng([seed, 31])
    kind = KINDS[seed % len(KINDS)]
    by_capture = bool(rng.integers(3) == 0)
    offset_m = tuple(float(value) for value in rng.uniform(-1.5, 1.5, 3))
    sign = -1.0 if kind == "clock step" and rng.integers(2) else 1.0
    stage = _STAGES[int(rng.integers(len(_STAGES)))]
    return SignalFault(
        seed=seed,
        cause=list(MISSIONS)[int(rng.integers(len(MISSIONS)))],
        kind=kind,
        message_id=None if by_capture else _MESSAGES[int(rng.integers(len(_MESSAGES)))],
        lone=bool(rng.integers(2)),
        stage=stage,
        after_s=float(rng.uniform(0.0, 5.0 if stage == "goal" else 1.0)),
        offset_m=(offset_m[0], offset_m[1], offset_m[2]),
        step_s=sign * float(rng.uniform(0.1, 2.0)),
    )


def shown_by_none(fault: SignalFault) -> bool:
    """Return whether no second source could show a fault: docs/verdicts.md lists these.

    An estimate states a metre: what it is off by less than five is within that, whatever else
    knows better. Motion capture that is alone has the estimate beside it, as exact as that.
    """
    if fault.kind not in {"bias", "jump"}:
        return False
    by_capture = fault.message_id is None
    return fault.lone if by_capture else fault.message_id == _MESSAGES[0]


def inject(fault: SignalFault, folder: Path) -> Outcome:
    """Fly a flight that must fail with a fault in it."""
    folder.mkdir(parents=True)
    run_folder = folder / "run"
    run_folder.mkdir()
    order = RunOrder(plan=_plan(fault, folder), folder=run_folder, clock="virtual")
    result = fly(RunSetup.of(order), lambda _: None, _Nobody(), disturb=_disturb(fault))
    wrong = result.verdict == "PASS" and not shown_by_none(fault)
    return Outcome(fault, result.verdict, result.reason, wrong)


class _Nobody:
    def poll(self) -> OperatorCommand | None:
        return None


def _plan(fault: SignalFault, folder: Path) -> Any:
    sets = MISSIONS[fault.cause]
    if fault.seed % 4:
        sets = (*sets, "vehicles.twin.autopilot=px4")
    if fault.message_id is None:
        sets = (*sets, "vehicles.twin.pose_source=mocap")
    return load_campaign(write_wall(folder), Options(sets=sets)).runs[0]


def _disturb(fault: SignalFault) -> Callable[[Pair, RunState], None]:
    if fault.message_id is None:
        trouble = captured("twin", _alter(fault), stage=fault.stage, after_s=fault.after_s)
    else:
        change = _change(fault)
        trouble = relay(
            "twin", change, stage=fault.stage, after_s=fault.after_s, message_id=fault.message_id
        )

    def disturb(pair: Pair, run_state: RunState) -> None:
        twin: Any = pair.vehicles["twin"]
        if fault.lone:
            twin._truth_callbacks.clear()
            if fault.message_id is not None:
                twin._mocap._callbacks.clear()
        trouble(pair, run_state)

    return disturb


def _change(fault: SignalFault) -> Change:
    first: list[bytes] = []

    def change(frame: Frame) -> Iterable[tuple[float, bytes]]:
        first.append(frame.raw)
        match fault.kind:
            case "stop":
                return
            case "freeze":
                yield 0.0, _stamped(frame, frame._replace(raw=first[0]))
            case "delay":
                yield abs(fault.step_s), frame.raw
            case "duplicate":
                yield 0.0, first[0]
            case _:
                yield 0.0, _altered(fault, frame, len(first))

    return change


def _stamped(now: Frame, then: Frame) -> bytes:
    """Return what was said then with the stamp of now, where the message has one."""
    if now.message_id not in {
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    }:
        return then.raw
    payload = now.payload.ljust(4, b"\0")[:4] + then.payload.ljust(32, b"\0")[4:]
    return with_payload(now, payload)


def _altered(fault: SignalFault, frame: Frame, count: int) -> bytes:
    if frame.message_id != mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
        if fault.kind == "nan" and frame.message_id == mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
            payload = frame.payload.ljust(32, b"\0")
            return with_payload(frame, payload[:4] + struct.pack("<f", math.nan) + payload[8:])
        return frame.raw
    said = Position.of(frame)
    place, velocity = said.values[:3], said.values[3:]
    match fault.kind:
        case "bias":
            place = tuple(a + b for a, b in zip(place, fault.offset_m, strict=True))
        case "jump" if count % 50 < 25:
            place = tuple(a + b for a, b in zip(place, fault.offset_m, strict=True))
        case "nan":
            place = (math.nan, *place[1:])
        case "clock step":
            boot_ms = max(0, said.boot_ms + round(fault.step_s * 1e3))
            said = replace(said, boot_ms=boot_ms)
        case _:
            pass
    return replace(said, values=(*place, *velocity)).in_place_of(frame)


def _alter(fault: SignalFault) -> Alter:
    first: list[PoseReading] = []
    late: list[PoseReading] = []

    def alter(reading: PoseReading) -> Iterable[PoseReading]:
        first.append(reading)
        moved = Pose(add(reading.pose.position_ned_m, fault.offset_m), reading.pose.q_wxyz)
        match fault.kind:
            case "freeze":
                yield replace(reading, pose=first[0].pose)
            case "delay":
                late.append(reading)
                while late and late[0].t_s <= reading.t_s - abs(fault.step_s):
                    yield late.pop(0)
            case "duplicate":
                yield first[0]
            case "bias":
                yield replace(reading, pose=moved)
            case "jump":
                yield replace(reading, pose=moved) if len(first) % 100 < 50 else reading
            case "nan":
                bad = Pose((math.nan, 0.0, 0.0), reading.pose.q_wxyz)
                yield replace(reading, pose=bad)
            case "clock step":
                yield replace(reading, t_s=reading.t_s + fault.step_s)
            case _:
                return

    return alter


def main(arguments: list[str]) -> None:
    first, count, folder = int(arguments[0]), int(arguments[1]), Path(arguments[2])
    for seed in range(first, first + count):
        outcome = inject(draw(seed), folder / str(seed))
        sys.stdout.write(json.dumps(asdict(outcome)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
