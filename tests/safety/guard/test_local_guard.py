import asyncio
from collections.abc import Coroutine
from contextlib import AsyncExitStack
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, Self

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import (
    AnchorAt,
    BringDown,
    OperatorAction,
    OrchestratorAlive,
    StartOutage,
)
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardEvent
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.local_guard import GuardLinks, LocalGuard
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.autopilots.autopilot import FlightMode, MavlinkTarget
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.worlds.frames import Pose

LATENCY_S = 0.003
FENCE = Fence.box(north_m=(-3, 5), east_m=(-3, 3), up_m=(-1, 6))
DRIVER = MavlinkCodec(system_id=245, component_id=190)
NAMES = {"real": 1, "twin": 2}


class Flight:
    """Two fake PX4 behind a local guard; the test is the orchestrator."""

    def __init__(self, make_vehicle: Any, **guarding: Any) -> None:
        self.log: list[tuple[str, float, bytes]] = []
        self.heard: dict[str, list[bytes]] = {name: [] for name in NAMES}
        self.told: list[GuardEvent] = []
        self.vehicles: dict[str, Any] = {}
        self.drivers: dict[str, Any] = {}
        self.gcs, gcs_end = memory_pair(name="gcs")
        self.gcs_heard: list[bytes] = []
        self.gcs.receive(lambda data, _: self.gcs_heard.append(data))
        self._ends: list[Any] = [self.gcs]
        self._air: dict[str, Any] = {}
        links: dict[str, GuardLinks] = {}
        for name, system in NAMES.items():
            self.vehicles[name] = make_vehicle(name, Px4(), system=system)
            self._air[name], near = memory_pair(latency_s=LATENCY_S, name=name)
            inner, self.drivers[name] = memory_pair(name=f"{name} guard")
            self._air[name].receive(self._vehicle_receiver(name))
            self.drivers[name].receive(self._driver_receiver(name))
            self._ends += [self._air[name], self.drivers[name]]
            links[name] = GuardLinks(near, inner, gcs_end if name == "real" else None)
        self.guard = LocalGuard(
            vehicles={
                name: GuardedVehicle(
                    autopilot=Px4(), target=MavlinkTarget(system), fence=FENCE, gcs=name == "real"
                )
                for name, system in NAMES.items()
            },
            links=links,
            **{"record": lambda *row: self.log.append(row), **guarding},
        )
        self.guard.on_event(self.told.append)

    def _vehicle_receiver(self, name: str) -> Any:
        return lambda data, t_s: self.vehicles[name].receive((data,), t_s)

    def _driver_receiver(self, name: str) -> Any:
        return lambda data, _: self.heard[name].append(data)

    async def __aenter__(self) -> Self:
        self._stack = AsyncExitStack()
        for end in self._ends:
            await self._stack.enter_async_context(end)
        await self._stack.enter_async_context(self.guard)
        self._live()
        await asyncio.sleep(1.0)
        return self

    async def __aexit__(self, *error: object) -> None:
        self._timer.cancel()
        await self._stack.aclose()

    def _live(self) -> None:
        loop = asyncio.get_running_loop()
        for name, vehicle in self.vehicles.items():
            vehicle.step(loop.time())
            if data := vehicle.frames(loop.time()):
                self._air[name].write(data)
            self.guard.position(vehicle.sample(loop.time()))
        self._timer = loop.call_later(0.05, self._live)

    def setpoint(self, name: str) -> None:
        message = Px4().velocity_setpoint(
            MavlinkTarget(NAMES[name]), t_boot_ms=0, velocity_ned_m_s=(1.0, 0.0, 0.0)
        )
        self.drivers[name].write(DRIVER.pack(message))

    def kinds(self) -> list[str]:
        return [event.kind for event in self.told if event.kind != "action"]


def fly(main: Coroutine[Any, Any, None]) -> None:
    run_virtual(main)


def test_bytes_pass_both_ways_and_are_recorded_frame_by_frame(fake_vehicle: Any) -> None:
    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            flight.setpoint("real")
            await asyncio.sleep(0.1)
            assert flight.vehicles["real"].words() == ["SET_POSITION_TARGET_LOCAL_NED"]
            assert flight.heard["real"]
            assert b"".join(flight.gcs_heard) == b"".join(flight.heard["real"])
            kinds = {(name, frame[5]) for name, _, frame in flight.log}
            assert kinds == {("real", 1), ("real", 245), ("twin", 2)}
            assert all(len(frame) == 12 + frame[1] for _, _, frame in flight.log)
            times = [t_s for _, t_s, _ in flight.log]
            assert times == sorted(times)

    fly(main())


def test_bring_down_lands_both_and_says_when(fake_vehicle: Any) -> None:
    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            assert not await flight.guard.all_down(1.0)
            flight.guard.send(BringDown("the twin never became ready"))
            assert await flight.guard.all_down(30.0)
            assert asyncio.get_running_loop().time() < 15.0
            assert not any(vehicle.armed for vehicle in flight.vehicles.values())
            assert set(flight.guard.phases.values()) == {ContingencyPhase.DOWN}
            assert flight.kinds() == ["bring_down"]
            assert flight.guard.events == flight.told

    fly(main())


def test_all_down_is_false_when_a_vehicle_does_not_come_down(fake_vehicle: Any) -> None:
    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            flight.vehicles["real"].deaf = True
            flight.guard.send(OperatorAction(OperatorCommand("abort", "Ctrl-C")))
            assert not await flight.guard.all_down(20.0)
            flight.vehicles["real"].deaf = False
            assert await flight.guard.all_down(20.0)

    fly(main())


def test_an_abort_is_at_the_vehicle_after_the_link_s_latency_alone(fake_vehicle: Any) -> None:
    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            flight.setpoint("real")
            await asyncio.sleep(0.01)
            now_s = asyncio.get_running_loop().time()
            flight.guard.send(OperatorAction(OperatorCommand("abort", "anna")))
            await asyncio.sleep(0.01)
            t_s, word = flight.vehicles["real"].heard[1]
            assert word == "ZERO"
            assert t_s == pytest.approx(now_s + LATENCY_S)
            flight.setpoint("real")
            await asyncio.sleep(0.1)
            assert "SET_POSITION_TARGET_LOCAL_NED" not in flight.vehicles["real"].words()[1:]

    fly(main())


def test_hold_and_resume_through_the_local_guard(fake_vehicle: Any) -> None:
    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            flight.guard.send(OperatorAction(OperatorCommand("hold", "anna")))
            await asyncio.sleep(3.0)
            assert {vehicle.mode for vehicle in flight.vehicles.values()} == {FlightMode.HOLD}
            flight.guard.send(OperatorAction(OperatorCommand("resume", "anna")))
            flight.setpoint("real")
            await asyncio.sleep(0.1)
            assert flight.vehicles["real"].words()[-1] == "SET_POSITION_TARGET_LOCAL_NED"
            assert flight.kinds() == ["hold", "resume"]

    fly(main())


def test_silence_of_an_orchestrator_task_that_was_killed(fake_vehicle: Any) -> None:
    async def main() -> None:
        async with Flight(fake_vehicle) as flight:

            async def beat() -> None:
                while True:
                    flight.guard.send(OrchestratorAlive())
                    await asyncio.sleep(0.1)

            task = asyncio.create_task(beat(), name="heartbeat")
            await asyncio.sleep(3.0)
            assert flight.kinds() == []
            task.cancel()
            killed_s = asyncio.get_running_loop().time()
            assert await flight.guard.all_down(30.0)
            assert flight.kinds() == ["silence"]
            silence = next(event for event in flight.told if event.kind == "silence")
            assert silence.t_s - killed_s <= 0.5

    fly(main())


def test_a_fence_breach_by_position_and_by_anchored_estimate(fake_vehicle: Any) -> None:
    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            flight.guard.send(AnchorAt("real", (0.0, 0.0, 0.0), 0.0))
            now_s = asyncio.get_running_loop().time()
            flight.guard.position(PoseSample(now_s, "real", Pose((9, 0, -2)), (0, 0, 0)))
            assert flight.kinds() == ["fence"]
            assert await flight.guard.all_down(30.0)

    fly(main())


def test_an_outage_is_of_one_link_and_of_one_that_can_have_it(fake_vehicle: Any) -> None:
    begun: list[tuple[str, float]] = []

    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            links: Any = flight.guard._links
            for name in NAMES:
                impaired = SimpleNamespace(start_outage=partial(_note_outage, begun, name))
                links[name] = replace(links[name], impaired=impaired)
            flight.guard.send(StartOutage("twin", 4.0))
            assert begun == [("twin", 4.0)]
            links["real"] = replace(links["real"], impaired=None)
            with pytest.raises(ValueError, match="the link of real does not support outages"):
                flight.guard.send(StartOutage("real", 4.0))
            assert flight.kinds() == []

    fly(main())


def _note_outage(begun: list[tuple[str, float]], name: str, duration_s: float) -> None:
    begun.append((name, duration_s))


def test_at_rest_and_all_down_follow_what_the_guard_sees(fake_vehicle: Any) -> None:
    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            assert not await flight.guard.at_rest(0.5)
            for vehicle in flight.vehicles.values():
                vehicle.armed = False
            assert await flight.guard.at_rest(5.0)
            assert not await flight.guard.all_down(0.5), "nothing brought them down"
            flight.guard.send(BringDown("done"))
            assert await flight.guard.all_down(5.0)
            flight.vehicles["twin"].armed = True
            await asyncio.sleep(2.0)
            assert not await flight.guard.at_rest(0.1)

    fly(main())


def test_a_log_that_cannot_be_written_does_not_stop_the_flight(fake_vehicle: Any) -> None:
    def full(name: str, t_s: float, frame: bytes) -> None:
        raise OSError(28, "No space left on device")

    async def main() -> None:
        async with Flight(fake_vehicle, record=full) as flight:
            flight.setpoint("real")
            await asyncio.sleep(1.0)
            assert flight.vehicles["real"].words() == ["SET_POSITION_TARGET_LOCAL_NED"]
            flight.guard.send(OperatorAction(OperatorCommand("abort", "anna")))
            assert await flight.guard.all_down(30.0)
            assert flight.kinds() == ["record", "record", "abort"]
            assert {one.vehicle for one in flight.told if one.kind == "record"} == {"real", "twin"}

    fly(main())


def test_the_log_of_one_vehicle_ends_alone(fake_vehicle: Any) -> None:
    kept: list[tuple[str, float]] = []

    def full(name: str, t_s: float, frame: bytes) -> None:
        if name == "real":
            raise OSError(28, "No space left on device")
        kept.append((name, t_s))

    async def main() -> None:
        async with Flight(fake_vehicle, record=full) as flight:
            await asyncio.sleep(2.0)
            (event,) = flight.told
            assert event.text == "the recording ended early: real.tlog: No space left on device"
            assert {name for name, _ in kept} == {"twin"}
            assert kept[-1][1] > event.t_s + 1.0

    fly(main())


def test_frames_leave_before_events_are_reported(fake_vehicle: Any) -> None:
    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            seen: list[int] = []
            before = len(flight.log)
            flight.guard.on_event(lambda _: seen.append(len(flight.log) - before))
            flight.guard.send(OperatorAction(OperatorCommand("abort", "anna")))
            assert seen
            assert min(seen) >= 4

    fly(main())


def test_telemetry_is_passed_on_before_it_is_judged(
    fake_vehicle: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []

    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            core, orchestrator = flight.guard.core, flight.guard._links["twin"].orchestrator
            write, judge = orchestrator.write, core.judge_vehicle

            def passing(data: bytes) -> None:
                order.append("passed")
                write(data)

            def judging(name: str, *frames: Any) -> Any:
                order.extend(["judged"] * (name == "twin"))
                return judge(name, *frames)

            monkeypatch.setattr(orchestrator, "write", passing)
            monkeypatch.setattr(core, "judge_vehicle", judging)
            await asyncio.sleep(0.2)

    fly(main())
    assert len(order) > 4
    assert order[::2] == ["passed"] * len(order[::2])
    assert order[1::2] == ["judged"] * len(order[1::2])


def test_ticks_keep_their_raster(fake_vehicle: Any) -> None:
    async def main() -> None:
        async with Flight(fake_vehicle) as flight:
            flight.guard.send(OperatorAction(OperatorCommand("abort", "anna")))
            for vehicle in flight.vehicles.values():
                vehicle.deaf = True
            await asyncio.sleep(1.0)
            mark = len(flight.log)
            await asyncio.sleep(2.0)
            ours = [
                t_s for name, t_s, frame in flight.log[mark:] if name == "real" and frame[6] == 191
            ]
            ticks = sorted(set(ours))
            assert len(ticks) == pytest.approx(40, abs=1)
            assert all(abs(t_s * 20 - round(t_s * 20)) < 1e-6 for t_s in ticks)

    fly(main())


def test_a_tick_comes_early_with_a_frame_and_none_twice(fake_vehicle: Any) -> None:
    async def main() -> None:
        now_s, ticks = asyncio.get_running_loop().time, list[float]()
        flight = Flight(fake_vehicle, early_s=0.048, ticked=lambda: ticks.append(now_s()))
        async with flight:
            ticks.clear()
            await asyncio.sleep(2.0)
            assert len(ticks) == pytest.approx(40, abs=1)
            # Frames come 3 ms after the raster: 47 ms before the next tick.
            assert all(t_s * 20 % 1 == pytest.approx(LATENCY_S * 20) for t_s in ticks)
            for end in flight._air.values():
                await end.__aexit__(None, None, None)
            await asyncio.sleep(0.5)
            ticks.clear()
            await asyncio.sleep(2.0)
            assert len(ticks) == pytest.approx(40, abs=1)
            assert all(abs(t_s * 20 - round(t_s * 20)) < 1e-6 for t_s in ticks)

    fly(main())


def test_vehicles_and_links_must_agree() -> None:
    with pytest.raises(ValueError, match="differ"):
        LocalGuard(vehicles={}, links={"real": GuardLinks(*memory_pair())})
