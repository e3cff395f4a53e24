"""What tests of oracles share: a scripted probe, samples, a scene with gates."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.oracle_results import Flag, OracleResult
from wil_campaign.safety.model.samples import PoseSample, Stage, StageSample, StateSample
from wil_campaign.safety.oracles.gates import gates_of
from wil_campaign.safety.oracles.oracle import Oracle, OracleContext
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import gate_shape

FENCE = Fence.box(north_m=(-1, 4), east_m=(-2, 2), up_m=(-0.5, 2.5))


@dataclass(frozen=True)
class Near:
    object_name: str
    part_name: str
    clearance_m: float
    at_s: float
    is_floor: bool


@dataclass
class ScriptedProbe:
    """Answers each sweep with what the script has for the time of its end."""

    script: dict[float, list[tuple[str, str, float]]]
    asked: list[tuple[float, float]] = field(default_factory=list)

    def reaching(self, _: float) -> Self:
        return self

    def above(self, _: float) -> Self:
        return self

    def sweep(
        self,
        pose_0: Pose,
        t_0_s: float,
        pose_1: Pose,
        t_1_s: float,
        events: Mapping[str, float],
        *,
        below_m: Mapping[tuple[str, bool], float] | None = None,
    ) -> tuple[Near, ...]:
        self.asked.append((t_0_s, t_1_s))
        near = [Near(*each, t_1_s, each[1] == "floor") for each in self.script.get(t_1_s, [])]
        limits = below_m or {}
        return tuple(
            n for n in near if n.clearance_m < limits.get((n.object_name, n.is_floor), math.inf)
        )


def build(kind: str, *, context: OracleContext | None = None, **parameters: Any) -> Oracle:
    spec = oracle_kinds()[kind]
    model = spec.parameters.model_validate(parameters)
    used = context or OracleContext(mode="wil", subject="real", vehicle="real", fence=FENCE)
    return spec.build(kind, model, used, required=model.required)


def pose(t_s: float, at: Vec3 = (0, 0, -1), velocity: Vec3 = (0, 0, 0)) -> PoseSample:
    return PoseSample(t_s, "real", Pose(at), velocity)


def state(
    t_s: float, *, armed: bool = True, landed: bool | None = False, fault: str | None = None
) -> StateSample:
    return StateSample(t_s, "real", armed, FlightMode.GUIDED, "OFFBOARD", landed, fault)


def stage(oracle: Oracle, **times: float) -> list[Flag]:
    flags: list[Flag] = []
    for name, t_s in times.items():
        flags += oracle.on_stage(StageSample(t_s, stage_of(name)))
    return flags


def stage_of(name: str) -> Stage:
    names: dict[str, Stage] = {
        "takeoff": "takeoff",
        "at_height": "at_height",
        "goal": "goal",
        "done": "done",
        "land": "land",
        "landed": "landed",
        "end": "end",
    }
    return names[name]


def numbers(result: OracleResult) -> tuple[object, ...]:
    return (result.verdict, result.actual, result.limit, result.margin, result.at_s)


def contact(script: dict[float, list[tuple[str, str, float]]]) -> tuple[Oracle, ScriptedProbe]:
    probe = ScriptedProbe(script)
    context = OracleContext(mode="wil", subject="real", vehicle="real", probe=probe)
    return build("collision", context=context), probe


SCENE = Scene(
    (
        SceneObject(1, "gate", gate_shape("square", 1.0, 0.1), Pose.of(3, 0, 1)),
        SceneObject(2, "ring", gate_shape("ring", 1.0, 0.1), Pose.of(6, 0, 1, yaw_rad=math.pi)),
    )
)


def reached(route: tuple[str, ...] = ("gate",), **parameters: object) -> Oracle:
    context = OracleContext(
        mode="wil", subject="real", vehicle="real", gates=gates_of(SCENE), route=route
    )
    return build("reached", context=context, **parameters)


def fly(judge: Oracle, *points: Vec3, start_s: float = 3.0) -> list[str]:
    flags: list[Flag] = []
    for i, point in enumerate(points):
        flags += judge.on_pose(pose(start_s + i, point))
    return [flag.text for flag in flags]
