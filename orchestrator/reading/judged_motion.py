"""The motion of vehicles as the oracles judged it, from judged.msgpack."""

from dataclasses import dataclass, field
from math import inf
from pathlib import Path

from wil_campaign.foundation.files.paths import open_at_once
from wil_campaign.safety.evaluation.judge_log import (
    ActorPose,
    JudgeLogError,
    LoggedWorldEvent,
    read_judge_log,
)
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.samples import FenceSample, PoseSample, StageSample
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.scene.track import RunHistory


@dataclass(slots=True)
class JudgedMotion:
    """Judged poses by vehicle with their times, and the velocities (NED, m/s) at each.

    world_events: their times, and the poses of actors. fences: those changed in flight by vehicle,
    each with the time from which it was in force, oldest first.
    """

    poses: dict[str, list[tuple[float, Pose]]] = field(default_factory=dict)
    velocities: dict[str, list[Vec3]] = field(default_factory=dict)
    world_events: RunHistory = field(default_factory=RunHistory)
    stages: dict[str, float] = field(default_factory=dict)
    fences: dict[str, list[tuple[float, Fence]]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    def near_ground_at(self, t_s: float) -> bool:
        """Return whether a vehicle may have been near the ground then, as oracles judge it."""
        return t_s < self.stages.get("at_height", inf) or t_s >= self.stages.get("land", inf)


def read_judged_motion(path: Path) -> JudgedMotion:
    """Return the motion in a judge log, as far as the file is readable."""
    found = JudgedMotion()
    try:
        with open_at_once(path) as stream:
            for sample in read_judge_log(stream):
                match sample:
                    case PoseSample(t_s, vehicle, pose, velocity):
                        found.poses.setdefault(vehicle, []).append((t_s, pose))
                        found.velocities.setdefault(vehicle, []).append(velocity)
                    case StageSample(t_s, stage, None):
                        found.stages.setdefault(stage, t_s)
                    case LoggedWorldEvent(t_s, name):
                        found.world_events.setdefault(name, t_s)
                    case ActorPose(t_s, name, pose, velocity):
                        found.world_events.add_pose(name, t_s, pose, velocity)
                    case FenceSample(t_s, vehicle, fence):
                        found.fences.setdefault(vehicle, []).append((t_s, fence))
                    case _:
                        pass
    except JudgeLogError as error:
        found.problems.append(f"{path.name} is damaged: {error}")
    except OSError as error:
        found.problems.append(f"{path.name} cannot be read: {error.strerror or error}")
    return found
