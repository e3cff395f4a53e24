"""Flights that must fail, with faults that the field has and no alteration of one signal shows.

A heading that is wrong, an estimator that loses its hold, a second sender, a ground station, a mesh
that has lost a part, an attempt that is flown again. `python -m tests.faults.field_faults FIRST
COUNT FOLDER` prints one JSON object for each flight.
"""

import asyncio
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import yaml
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.faults import lost_parts, washing
from tests.faults.alterations import MESSAGES
from tests.faults.ground_station import SENDS, TAKES_OVER, GroundStation
from tests.faults.missions import CAUSES, AutopilotKind, Cause
from tests.faults.signals import Outcome, SignalFault, draw, fly_mission, fly_seeds, silence_better
from tests.faults.wire_changes import BOARDS, HEADINGS, OTHERS, UIDS, Hold, WireFault, through
from tests.orchestrator.flights import log_of
from wil_campaign.foundation.files.problems import BadInput
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.vehicles.mavlink.heartbeats import HeartbeatKind

POSSIBLE: Mapping[str, Sequence[str]] = {
    "heading": HEADINGS,
    "estimator's hold": get_args(Hold),
    "second sender": (*BOARDS, *BOARDS, UIDS, *OTHERS),
    "ground station": SENDS,
    "mesh": tuple(lost_parts.LOST),
    "retry": washing.WASHED,
}
"""What is faulty, and how, as often as it stands here."""
_OFTEN = (
    *("heading",) * 5,
    *("estimator's hold",) * 4,
    *("second sender",) * 5,
    *("ground station",) * 4,
    *("mesh",) * 3,
    "retry",
)
_MESHES: tuple[Cause, ...] = ("wall", "table")
_WASHED: tuple[Cause, ...] = ("wall", "fence", "area", "formula")
_IN_FLIGHT: tuple[Stage, ...] = ("takeoff", "at_height", "goal", "land")
_BEFORE: tuple[Stage, ...] = ("identify", "ready")
_UNTIL_LANDING = frozenset({"turns", "settles"})
"""Faults that take seconds until they are there, or are found."""
BOARD: Mapping[AutopilotKind, HeartbeatKind] = {
    "px4": HeartbeatKind(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4),
    "ardupilot": HeartbeatKind(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
}


def draw_field(seed: int) -> SignalFault:
    """Return the fault of a seed. Half of the flights are sound but for it."""
    rng = np.random.default_rng([seed, 42])
    base = draw(seed)
    signal = _OFTEN[int(rng.integers(len(_OFTEN)))]
    kind = POSSIBLE[signal][int(rng.integers(len(POSSIBLE[signal])))]
    drawn = replace(
        base,
        signal=signal,
        vehicle=base.subject,
        judged_by="mavlink" if rng.random() < 0.7 else base.judged_by,
        cause="none" if rng.random() < 0.5 else CAUSES[int(rng.integers(len(CAUSES)))],
        alteration=replace(base.alteration, kind=kind),
    )
    stages = [*_IN_FLIGHT, *(_BEFORE if signal in {"second sender", "ground station"} else ())]
    if kind in _UNTIL_LANDING or "anew" in kind:
        stages.remove("land")
    stage = stages[int(rng.integers(len(stages)))]
    after_s = float(rng.uniform(0.0, 3.0 if stage == "goal" else 1.0))
    drawn = replace(drawn, stage=stage, after_s=after_s)
    match signal:
        case "heading" if drawn.cause == "none":
            # Where another source is judged, it anchors the frame, too.
            return replace(drawn, judged_by="mavlink")
        case "second sender" if kind == UIDS:
            return replace(drawn, stage="start", after_s=0.0)
        case "mesh":
            cause = _MESHES[int(rng.integers(len(_MESHES)))]
            return replace(drawn, cause=cause, mode="sim", vehicle="twin", after_s=rng.random())
        case "retry":
            cause = _WASHED[int(rng.integers(len(_WASHED)))] if kind == washing.SIGNAL else "none"
            return replace(drawn, cause=cause, mode="sim", vehicle="twin", judged_by="mavlink")
    return drawn


def inject_field(fault: SignalFault, folder: Path) -> Outcome:
    """Fly a flight that must fail with a fault in it."""
    match fault.signal:
        case "mesh":
            return _fly_without_a_part(fault, folder)
        case "retry":
            return washing.inject(fault, _washed(fault), folder)
        case "ground station":
            return _fly_beside_a_station(fault, folder)
    return _fly_through_a_wire(fault, folder)


def _washed(fault: SignalFault) -> SignalFault:
    """Return the fault of a first attempt: of a signal while the mission fails, or none.

    The signal becomes faulty shortly before or after the mission has failed.
    """
    rng = np.random.default_rng([fault.seed, 43])
    others = (draw(int(rng.integers(1_000_000))) for _ in range(1_000))
    base = next(one for one in others if one.signal in MESSAGES and one.mode == "sim")
    after_s = float(rng.uniform(1.0, 4.0))
    return replace(base, cause=fault.cause, stage="goal", after_s=after_s, seed=fault.seed)


def _outcome(fault: SignalFault, result: RunResult, *, exempt: bool = False) -> Outcome:
    wrong = result.verdict == "PASS" and not exempt
    return Outcome(fault, result.verdict, result.reason, result.decided_by or "", exempt, wrong)


def _active(fault: SignalFault, run_state: RunState) -> Callable[[], bool]:
    def is_active() -> bool:
        since_s = run_state.entered_s.get(fault.stage)
        now_s = asyncio.get_running_loop().time()
        return since_s is not None and now_s >= since_s + fault.after_s

    return is_active


def _fly_through_a_wire(fault: SignalFault, folder: Path) -> Outcome:
    """Exempt: somebody else's words in a sound flight, where the log names the sender."""

    def disturb(pair: VehiclePair, run_state: RunState) -> None:
        silence_better(fault, pair, run_state)
        wire = WireFault(
            fault.kind,
            _active(fault, run_state),
            fault.alteration.offset_m,
            BOARD[fault.autopilot if fault.vehicle == fault.subject else "px4"],
        )
        through(lambda frame, _: wire.change(frame), fault.vehicle)(pair, run_state)

    result = fly_mission(fault, folder, disturb)
    named = any(one.get("kind") == "other_sender" for one in log_of(folder / "run"))
    harmless = fault.cause == "none" and fault.kind in OTHERS
    return _outcome(fault, result, exempt=harmless and (named or fault.kind == "text"))


def _fly_beside_a_station(fault: SignalFault, folder: Path) -> Outcome:
    """Exempt: a sound flight, where nothing reached the vehicle and the guard names what came."""
    stations: list[GroundStation] = []

    def disturb(pair: VehiclePair, run_state: RunState) -> None:
        silence_better(fault, pair, run_state)
        is_active = _active(fault, run_state)
        station = GroundStation(fault.vehicle, fault.kind, fault.autopilot, is_active)
        station.disturb(pair, run_state)
        stations.append(station)

    result = fly_mission(fault, folder, disturb)
    (station,) = stations
    kept_off = station.sent and not station.arrived and station.events
    harmless = fault.cause == "none" and fault.kind not in TAKES_OVER
    return _outcome(fault, result, exempt=bool(harmless and kept_off))


def _fly_without_a_part(fault: SignalFault, folder: Path) -> Outcome:
    """Exempt: a file in which nothing says that more was meant."""
    data = b""

    def prepare(where: Path) -> None:
        nonlocal data
        path = where / "world.yaml"
        world = yaml.safe_load(path.read_text())
        (given,) = world["objects"].values()
        size_m = given["shape"]["box"]["size_m"]
        name, data = lost_parts.mesh_file(fault.kind, size_m, fault.after_s)
        (where / name).write_bytes(data)
        given["shape"] = {"mesh": {"file": name, "unit": "m", "up": "z", "forward": "x"}}
        path.write_text(yaml.safe_dump(world))

    try:
        result = fly_mission(fault, folder, None, prepare)
    except BadInput as error:
        if "mesh file" not in str(error):
            raise
        return Outcome(fault, "refused", str(error), "", exempt=False, wrong=False)
    return _outcome(fault, result, exempt=lost_parts.is_whole(fault.kind, data))


if __name__ == "__main__":
    fly_seeds(draw_field, sys.argv[1:], inject_field)
