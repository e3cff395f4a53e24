"""Faults of an embedded vehicle at their moments, in virtual time."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from wil_campaign.vehicles.embedded.process.vehicle_faults import VehicleFaults
from wil_campaign.vehicles.faults import FaultTextError, parse_fault
from wil_campaign.vehicles.poses.truth import TruthSample

BOTH = pytest.mark.parametrize(
    ("autopilot", "truth", "truth_id"),
    [("px4", "HIL_STATE_QUATERNION", 115), ("ardupilot", "SIM_STATE", 108)],
)
Virtually = Callable[[Any], Any]


def faults_of(rig: Any, *, texts: list[str] | None = None) -> tuple[VehicleFaults, list[str]]:
    """Return the faults of a rig's vehicle, and what was done: `kill` and what is reported."""
    done: list[str] = [] if texts is None else texts
    faults = VehicleFaults(rig.vehicle, kill=lambda: done.append("killed"), report=done.append)
    return faults, done


def since(rig: Any, kind: str, t_s: float) -> list[tuple[float, Any]]:
    return [(at_s, m) for at_s, m in rig.heard if m.get_type() == kind and at_s >= t_s]


def attitude(truth: Any) -> tuple[float, ...]:
    """Return the attitude in a message of the ground truth."""
    if truth.get_type() == "HIL_STATE_QUATERNION":
        return tuple(truth.attitude_quaternion)
    return (truth.q1, truth.q2, truth.q3, truth.q4)


@BOTH
def test_a_mute_begins_and_ends_at_its_moments(
    rig: Any, virtually: Virtually, autopilot: str, truth: str, truth_id: int
) -> None:
    del truth, truth_id

    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            faults, done = faults_of(r)
            began_s = asyncio.get_running_loop().time()
            faults.inject(parse_fault("mute@3+4"))
            await asyncio.sleep(10.0)
            times = [t_s - began_s for t_s, m in r.heard if m.get_type() == "HEARTBEAT"]
            assert [t_s for t_s in times if t_s < 3.0]
            assert not [t_s for t_s in times if 3.01 < t_s < 7.0]
            assert [t_s for t_s in times if t_s > 7.0]
            assert done == ["fault begun: mute@3+4", "fault ended: mute@3+4"]

    virtually(scenario())


@pytest.mark.parametrize("faults", [("mute@3+3", "mute@5+4"), ("mute@3+6", "mute@4+2")])
def test_the_end_of_one_of_two_faults_does_not_end_the_other(
    rig: Any, virtually: Virtually, faults: tuple[str, str]
) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            injected, _ = faults_of(r)
            began_s = asyncio.get_running_loop().time()
            for text in faults:
                injected.inject(parse_fault(text))
            await asyncio.sleep(12.0)
            times = [t_s - began_s for t_s, m in r.heard if m.get_type() == "HEARTBEAT"]
            assert not [t_s for t_s in times if 3.01 < t_s < 9.0]
            assert [t_s for t_s in times if t_s > 9.0]

    virtually(scenario())


def test_an_unmute_ends_a_mute_that_would_last_longer(rig: Any, virtually: Virtually) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            faults, _ = faults_of(r)
            began_s = asyncio.get_running_loop().time()
            for text in ("mute@2+4", "unmute@4", "mute@5+4"):
                faults.inject(parse_fault(text))
            await asyncio.sleep(11.0)
            times = [t_s - began_s for t_s, m in r.heard if m.get_type() == "HEARTBEAT"]
            assert [t_s for t_s in times if 4.0 < t_s < 5.0]
            assert not [t_s for t_s in times if 5.01 < t_s < 9.0]
            assert [t_s for t_s in times if t_s > 9.0]

    virtually(scenario())


def test_a_motor_fails_at_its_moment_and_the_vehicle_falls(rig: Any, virtually: Virtually) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            faults, _ = faults_of(r)
            await r.hover()
            faults.inject(parse_fault("motor@2"))
            await asyncio.sleep(1.9)
            assert r.height_m > 2.5
            await asyncio.sleep(4.0)
            assert r.height_m < 1.0

    virtually(scenario())


def test_a_motor_that_comes_back_carries_again(rig: Any, virtually: Virtually) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            faults, _ = faults_of(r)
            await r.hover()

            def share() -> float:
                """Return what part of the commanded thrust the second motor gives."""
                commanded = r.vehicle.autopilot.state.thrusts[1]
                return float(r.vehicle.truth().thrusts_n[1] / commanded)

            whole = share()
            faults.inject(parse_fault("motor 1 0.8@1+3"))
            await asyncio.sleep(3.9)
            assert share() == pytest.approx(0.8 * whole, rel=0.05)
            await asyncio.sleep(3.0)
            assert share() == pytest.approx(whole, rel=0.05)

    virtually(scenario())


@BOTH
def test_a_pose_source_that_stops_or_freezes_is_the_ground_truth_alone(
    rig: Any, virtually: Virtually, autopilot: str, truth: str, truth_id: int
) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            faults, _ = faults_of(r)
            truths: list[TruthSample] = []

            def restamp(last: TruthSample, new: TruthSample) -> TruthSample:
                return last._replace(t_s=new.t_s)

            r.vehicle.on_truth(faults.through("pose_source", restamp, truths.append), 50.0)
            await r.hover()
            assert await r.command(511, truth_id, 1e5) == 0
            assert await r.command(511, 32, 1e5) == 0
            await asyncio.sleep(1.0)
            loop = asyncio.get_running_loop()

            begun_s = loop.time()
            faults.inject(parse_fault("pose_source stop@0+2"))
            await asyncio.sleep(2.0)
            assert len(since(r, truth, begun_s + 0.01)) == 0
            assert [one for one in truths if one.t_s > begun_s + 0.01] == []
            assert len(since(r, "LOCAL_POSITION_NED", begun_s)) >= 18

            begun_s = loop.time()
            faults.inject(parse_fault("pose_source freeze@0+2"))
            await asyncio.sleep(2.0)
            attitudes = {attitude(m) for _, m in since(r, truth, begun_s + 0.01)}
            assert len(attitudes) == 1
            frozen = [one for one in truths if one.t_s > begun_s + 0.01]
            assert len({one.pose for one in frozen}) == 1
            assert len({one.t_s for one in frozen}) == len(frozen) > 90
            estimates = since(r, "LOCAL_POSITION_NED", begun_s)
            assert len({(m.x, m.y, m.z) for _, m in estimates}) >= 18

            begun_s = loop.time()
            await asyncio.sleep(2.0)
            assert len({attitude(m) for _, m in since(r, truth, begun_s)}) > 1

    virtually(scenario())


def test_an_estimate_that_freezes_goes_on_with_its_times(rig: Any, virtually: Virtually) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            faults, _ = faults_of(r)
            await r.hover()
            begun_s = asyncio.get_running_loop().time()
            faults.inject(parse_fault("estimate freeze"))
            await asyncio.sleep(2.0)
            for kind in ("LOCAL_POSITION_NED", "ATTITUDE", "GLOBAL_POSITION_INT"):
                messages = [m for _, m in since(r, kind, begun_s + 0.02)]
                assert len({m.time_boot_ms for m in messages}) == len(messages) > 5, kind
            places = {(m.x, m.y, m.z) for _, m in since(r, "LOCAL_POSITION_NED", begun_s + 0.02)}
            assert len(places) == 1
            assert r.last["HEARTBEAT"] is not None

    virtually(scenario())


def test_a_kill_and_an_absent_signal(rig: Any, virtually: Virtually) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            faults, done = faults_of(r)
            with pytest.raises(FaultTextError, match="this vehicle has no camera"):
                faults.inject(parse_fault("camera stop"))
            faults.inject(parse_fault("kill@1"))
            await asyncio.sleep(0.9)
            assert done == []
            await asyncio.sleep(0.2)
            assert done == ["fault begun: kill@1", "killed"]

    virtually(scenario())
