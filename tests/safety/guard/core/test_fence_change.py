"""A fence is changed in flight: when it may be, and what the guard makes of it."""

from typing import Any

import pytest

from tests.safety.oracles.oracle_rigs import build, pose, stage
from wil_campaign.safety.fence.areas import Circle
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.stopping import VehicleMotion
from wil_campaign.safety.guard.core.commands import NewFences, OperatorAction
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardEvent, GuardSettings
from wil_campaign.safety.guard.core.fence_exchange import refusal_of_change
from wil_campaign.safety.guard.core.guard_core import GuardCore
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.model.samples import FenceSample, PoseSample
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.worlds.frames import Pose, Vec3

OLD = Fence.box(north_m=(-5, 5), east_m=(-5, 5), up_m=(-1, 5))
NEW = Fence.box(north_m=(-1, 2), east_m=(-1, 1), up_m=(-1, 2))


def why(at: Vec3, velocity: Vec3 = (0, 0, 0), *, keep_m: float = 0.0) -> str:
    return refusal_of_change(
        NEW, VehicleMotion(at, velocity), latency_s=0.5, braking_m_s2=2.5, keep_m=keep_m
    )


@pytest.mark.parametrize(
    ("said", "refusal"),
    [
        ("", why((0, 0, -1))),
        ("it is 1.00 m outside of the fence's north side", why((3, 0, -1))),
        ("it is 1.00 m outside of the fence's ceiling", why((0, 0, -3))),
        ("it cannot stop before the fence's north side, 1.00 m away", why((1, 0, -1), (2, 0, 0))),
        ("", why((1, 0, -1), (-0.5, 0, 0))),
        ("it is 0.20 m from the fence's ceiling, nearer than 0.3 m", why((0, 0, -1.8), keep_m=0.3)),
    ],
)
def test_a_fence_that_may_not_be_changed_is_refused_with_the_reason(
    said: str, refusal: str
) -> None:
    assert refusal == said


def test_a_vehicle_that_is_not_seen_keeps_its_fence() -> None:
    core = core_of_two()
    text = "anna: geofence: real: no position was received within the last second"
    assert event_texts(core.apply(NewFences("anna", {"real": NEW}, proposed=True), 1.0)) == [
        ("refused", text)
    ]
    core.position(place("real", 0.0, 1.0))
    (proposed,) = event_texts(core.apply(NewFences("anna", {"real": NEW}, proposed=True), 1.5))
    wanted = (
        "anna requests another fence for real; the old one applies until the autopilot "
        "has the new one"
    )
    assert proposed == ("proposed", wanted)
    assert fence_of(core, "real") is OLD
    assert event_texts(core.apply(NewFences("anna", {"real": NEW}, proposed=True), 2.5)) == [
        ("refused", text)
    ]


def place(name: str, north_m: float, t_s: float) -> PoseSample:
    return PoseSample(t_s, name, Pose((north_m, 0, -1)), (0, 0, 0))


def core_of_two() -> GuardCore:
    vehicles = {
        name: GuardedVehicle(autopilot=Px4(), target=MavlinkTarget(number), fence=OLD)
        for number, name in enumerate(("real", "twin"), 1)
    }
    return GuardCore(vehicles=vehicles, settings=GuardSettings(keep_m=0.1))


def event_texts(outputs: tuple[object, ...]) -> list[tuple[str, str]]:
    return [(o.kind, o.text) for o in outputs if isinstance(o, GuardEvent)]


def fence_of(core: GuardCore, name: str) -> Fence | None:
    return core._supervised_vehicles[name].vehicle.fence


def test_the_guard_changes_all_fences_or_none() -> None:
    core = core_of_two()
    core.position(place("real", 0.0, 1.0))
    core.position(place("twin", 3.0, 1.0))
    both = {"real": NEW, "twin": NEW}
    assert event_texts(core.apply(NewFences("anna", both), 1.2)) == [
        ("refused", "anna: geofence: twin: it is 1.00 m outside of the fence's north side")
    ]
    assert fence_of(core, "real") is fence_of(core, "twin") is OLD
    core.position(place("twin", 1.0, 1.3))
    assert [
        kind for kind, _ in event_texts(core.apply(NewFences("anna", both, proposed=True), 1.4))
    ] == ["proposed"]
    assert fence_of(core, "real") is OLD
    assert event_texts(core.apply(NewFences("anna", both), 1.4)) == [
        ("geofence", "anna changed the fence of real and twin")
    ]
    assert fence_of(core, "real") is fence_of(core, "twin") is NEW


def test_a_vehicle_that_lands_already_keeps_its_fence() -> None:
    core = core_of_two()
    core.position(place("real", 0.0, 1.0))
    core.apply(OperatorAction(OperatorCommand("abort", "bert")), 1.1)
    assert event_texts(core.apply(NewFences("anna", {"real": NEW}), 1.2)) == [
        ("refused", "anna: geofence: all vehicles are landing")
    ]
    assert fence_of(core, "real") is OLD


def test_the_new_fence_is_the_one_that_is_watched(pair: Any) -> None:
    pair.fly(1.0)
    small = Fence(inclusions=[Circle((0.0, 0.0), 1.0)], ceiling_up_m=9.0)
    pair.apply(pair.core.apply(NewFences("anna", {"real": small}), pair.t_s))
    assert pair.kinds() == ["geofence"]
    pair.vehicles["real"].north_m_s = 0.5
    pair.fly(3.0)
    assert pair.core.latched == "fence"


def test_the_oracle_judges_by_the_fence_in_force() -> None:
    judge = build("geofence")
    window: dict[str, Any] = {"from": "takeoff"}
    formula = build("stl", stl="always (fence_margin_m >= 0)", **window)
    for oracle in (judge, formula):
        stage(oracle, takeoff=0.0)
        oracle.on_pose(pose(0.0, (3, 0, -1)))
        oracle.on_fence(FenceSample(1.5, "real", NEW))
        assert oracle.result(2.0).verdict == "PASS"
        oracle.on_pose(pose(2.0, (3, 0, -1)))
        assert oracle.result(2.0).verdict == "FAIL"
        assert oracle.result(2.0).at_s == 2.0


def test_an_area_of_an_oracle_is_not_the_operators_to_change() -> None:
    judge = build("area", keep={"box": {"north_m": (-5, 5), "east_m": (-5, 5), "up_m": (-1, 5)}})
    stage(judge, takeoff=0.0)
    judge.on_fence(FenceSample(0.5, "real", NEW))
    judge.on_pose(pose(1.0, (3, 0, -1)))
    assert judge.result(2.0).verdict == "PASS"
