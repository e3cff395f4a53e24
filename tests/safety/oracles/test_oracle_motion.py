"""Oracles that judge velocities or attitudes say so: without it no evidence of these is asked for.

What a body's extent makes of an attitude, and what carries a pose to the time of another vehicle's,
is none of it: the body is a point here, and both vehicles are sampled at the same times.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any, Self, get_args

import pytest

from tests.safety.oracles.oracle_rigs import FENCE, SCENE, Near, build
from tests.safety.oracles.test_oracles import NEVER_FED
from wil_campaign.plugins.stl.stl_signals import signals_of
from wil_campaign.safety.model.oracle_results import Flag, OracleResult
from wil_campaign.safety.model.samples import (
    LinkSample,
    PoseSample,
    ReferenceSample,
    Stage,
    StageSample,
    StateSample,
)
from wil_campaign.safety.oracles.gates import gates_of
from wil_campaign.safety.oracles.oracle import MotionName, Oracle, OracleContext
from wil_campaign.safety.oracles.oracle_terms import FLIGHT, StageTracker
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose, Vec3, norm, quat_from_euler, scale, subtract

Angles = tuple[float, float, float]
VELOCITY: Vec3 = (0.5, 0.2, -0.3)
ANGLES: Angles = (0.1, 0.2, 0.3)
MOVED: Mapping[MotionName, tuple[Vec3, Angles]] = {
    "velocity": ((1.9, -0.7, 0.8), ANGLES),
    "attitude": (VELOCITY, (-0.4, 0.5, -2.0)),
}
"""Largest velocity, and roll, pitch and yaw, of another flight: it differs by one of the two."""
STAGES: Mapping[int, Stage] = {0: "takeoff", 5: "at_height", 10: "goal", 80: "done", 85: "land"}


class OfPoint:
    """A clearance probe of a vehicle that is a point: how far it is from each object's centre."""

    def __init__(self, *names: str) -> None:
        self._names = names or SCENE.names

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
        del pose_0, t_0_s, events, below_m
        places = {name: SCENE[name].pose.position_ned_m for name in self._names}
        far_m = {n: norm(subtract(pose_1.position_ned_m, at)) for n, at in places.items()}
        return tuple(Near(name, "", each, t_1_s, False) for name, each in far_m.items())


CONTEXT = OracleContext(
    mode="wil",
    subject="real",
    vehicle="real",
    probe=OfPoint(),
    things=SCENE.names,
    probe_of=OfPoint,
    gates=gates_of(SCENE),
    route=("gate",),
    target_ned_m=(3.0, 0.0, -1.0),
    fence=FENCE,
)


Sample = PoseSample | ReferenceSample | StateSample | LinkSample


def samples(velocity: Vec3, angles: Angles) -> Iterator[Sample]:
    """A flight through the gate, velocity and attitude to and fro; the twin stands beside it."""
    for k in range(90):
        t_s, at, share = k / 10.0, (k / 12.0 - 1.0, 0.0, -1.0), math.cos(k / 5.0)
        q_wxyz = quat_from_euler(*(angle * share for angle in angles))
        yield PoseSample(t_s, "real", Pose(at, q_wxyz), scale(velocity, share))
        yield ReferenceSample(
            t_s - 0.02, "real", "truth", at, (1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
        )
        yield PoseSample(t_s, "twin", Pose((0.0, 1.0, -1.0)), (0.0, 0.0, 0.0))
        for vehicle in ("real", "twin"):
            yield LinkSample(t_s, vehicle)
            yield StateSample(
                t_s, vehicle, True, FlightMode.GUIDED, "OFFBOARD", k >= 88, None, 0.8, 11.0, None
            )


def flown(judge: Oracle, velocity: Vec3, angles: Angles) -> tuple[OracleResult, list[Flag]]:
    """Feed an oracle one flight; what it says."""
    flags: list[Flag] = []
    for sample in samples(velocity, angles):
        k = round(sample.t_s * 10.0)
        if isinstance(sample, PoseSample) and sample.vehicle == "real" and k in STAGES:
            flags += judge.on_stage(StageSample(sample.t_s, STAGES[k]))
        match sample:
            case _ if sample.vehicle not in judge.watches:
                continue
            case PoseSample():
                flags += judge.on_pose(sample)
            case ReferenceSample():
                flags += judge.on_reference(sample)
            case StateSample():
                flags += judge.on_state(sample)
            case LinkSample():
                flags += judge.on_received(sample)
        if not isinstance(sample, ReferenceSample):
            flags += judge.on_tick(sample.t_s)
    flags += judge.on_stage(StageSample(9.0, "landed"))
    flags += judge.on_stage(StageSample(9.5, "end"))
    return judge.result(9.5), flags


def formulas() -> Iterator[str]:
    """One STL formula of each signal, so that its least value is the margin."""
    for name, signal in signals_of(CONTEXT, StageTracker(FLIGHT)).items():
        yield f"always ({name}{' >= -400' if signal.kind.unit else ''})"


def uses() -> Iterator[tuple[str, dict[str, Any]]]:
    """Every oracle as the test of no samples has it, and by each word that it offers to choose."""
    for kind, given in NEVER_FED:
        yield kind, given
        for key, field in oracle_kinds()[kind].parameters.model_fields.items():
            if key in {"vehicle", "from_", "to"}:
                continue
            words = [one for one in get_args(field.annotation) if isinstance(one, str)]
            yield from ((kind, {**given, key: word}) for word in words)
    yield from (("attitude", {f"max_{angle}_deg": 90.0}) for angle in ("roll", "pitch"))
    yield from (("stl", {"stl": text}) for text in formulas())


def label(use: tuple[str, dict[str, Any]]) -> str:
    return " ".join([use[0], *(f"{key}={value}" for key, value in use[1].items())])


@pytest.mark.parametrize("motion", get_args(MotionName))
@pytest.mark.parametrize("use", tuple(uses()), ids=label)
def test_an_oracle_whose_result_changes_with_a_motion_names_it(
    use: tuple[str, dict[str, Any]], motion: MotionName
) -> None:
    kind, given = use
    judge, other = (build(kind, context=CONTEXT, **given) for _ in range(2))
    result = flown(judge, VELOCITY, ANGLES)
    assert result[0].verdict != "INVALID", f"the flight of this test lacks what it judges: {result}"
    changes = result != flown(other, *MOVED[motion])
    assert changes == (motion in judge.motion), (
        f"{kind} {'judges' if changes else 'does not judge'} the {motion} of a pose; its `motion` "
        f"is {set(judge.motion) or '{}'}: without the name the evidence of a run holds none of it"
    )
