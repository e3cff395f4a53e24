"""How fast moving objects were by mode, and with which spread: from what was recorded of them."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wil_campaign.orchestrator.reading.judged_motion import JudgedMotion, read_judged_motion
from wil_campaign.orchestrator.reading.model import RunEntry
from wil_campaign.orchestrator.report.reading.recorded_sights import read_facts
from wil_campaign.orchestrator.report.reading.world_facts import recorded_world
from wil_campaign.plugins.statistics.pass_rates import MODES, is_proven
from wil_campaign.worlds.jit import F64
from wil_campaign.worlds.scene.scene import SceneObject

_STEP_S = 0.1
_MOST = 20_000
_MOVES_M_S = 0.05
"""A slower object stands."""


@dataclass(frozen=True, slots=True)
class ObjectSpeed:
    """The speed of a moving object in a case and mode, m/s; from where it begins to where it ends.

    mean_m_s: mean of the flights' means. within_m_s: mean of the flights' standard deviations over
    time, the figure of the paper. between_m_s: standard deviation of the flights' means; None for
    a single flight.
    """

    case: str
    mode: str
    object: str
    flights: int
    mean_m_s: float
    within_m_s: float
    between_m_s: float | None


def read_object_speeds(folder: Path, entries: Iterable[RunEntry]) -> tuple[ObjectSpeed, ...]:
    """Return the speeds of what moved in the runs of a results folder; controls are left out.

    A run without a recorded world or poses does not count, and an object that stood neither.
    """
    found: dict[tuple[str, str, str], list[F64]] = {}
    for entry in entries:
        if entry.result is None or entry.result.control is not None or not is_proven(entry.result):
            continue
        for name, speeds in _speeds(folder / entry.name, entry):
            found.setdefault((entry.case, name, entry.mode), []).append(speeds)
    cases = list(dict.fromkeys(case for case, _, _ in found))
    keys = sorted(found, key=lambda key: (cases.index(key[0]), key[1], _place(key[2])))
    return tuple(object_speed(*key, found[key]) for key in keys)


def _place(mode: str) -> int:
    return MODES.index(mode) if mode in MODES else len(MODES)


def object_speed(case: str, name: str, mode: str, flights: Sequence[F64]) -> ObjectSpeed:
    """Return mean and spread of an object's speeds; flights: of each its speeds over time, m/s."""
    means = [float(flight.mean()) for flight in flights]
    return ObjectSpeed(
        case=case,
        mode=mode,
        object=name,
        flights=len(flights),
        mean_m_s=math.fsum(means) / len(means),
        within_m_s=math.fsum(float(flight.std()) for flight in flights) / len(flights),
        between_m_s=float(np.std(means, ddof=1)) if len(means) > 1 else None,
    )


def _speeds(place: Path, entry: RunEntry) -> Iterator[tuple[str, F64]]:
    """Yield name and speeds of each object that moved under a run's goal."""
    world = recorded_world(read_facts(place / "run.mcap"), entry.case, entry.mode)
    moving = [
        scene_object for scene_object in world.judged.objects if scene_object.motion is not None
    ]
    if not moving:
        return
    judged = read_judged_motion(place / "judged.msgpack")
    times = _times(judged)
    for scene_object in moving if len(times) > 1 else ():
        speeds = speeds_over_time(scene_object, judged, times)
        if len(speeds):
            yield scene_object.name, speeds


def _times(judged: JudgedMotion) -> F64:
    """Return even times from the goal until the vehicles land; empty without a goal."""
    begin_s = judged.stages.get("goal")
    lasts = [poses[-1][0] for poses in judged.poses.values() if poses]
    if begin_s is None or not lasts:
        return np.zeros(0)
    ends = [judged.stages[one] for one in ("done", "land", "end") if one in judged.stages]
    count = int((min([*ends, *lasts]) - begin_s) / _STEP_S + 1e-6) + 1
    return begin_s + _STEP_S * np.arange(max(0, min(count, _MOST)), dtype=np.float64)


def speeds_over_time(moving: SceneObject, judged: JudgedMotion, times: F64) -> F64:
    """Return an object's speeds between times, from its first motion to its last; m/s.

    Pauses in between count. An object that a vehicle flies is where that one was recorded.
    """
    poses = [moving.pose_at(float(t_s), judged.world_events) for t_s in times]
    places = np.array([pose.position_ned_m for pose in poses])
    speeds: F64 = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times)
    (moves,) = np.nonzero(speeds > _MOVES_M_S)
    return speeds[moves[0] : moves[-1] + 1] if len(moves) else speeds[:0]
