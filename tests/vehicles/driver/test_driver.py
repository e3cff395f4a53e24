"""Conformance: the driver flies the embedded vehicle, both autopilots, as it would a real one."""

import asyncio
import itertools
import math
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.ports import free_port
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample, VehicleEvent
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.errors import (
    ArmRefusedError,
    CommandError,
    IdentifyError,
    NotReadyError,
    ParameterError,
)
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.links.tapped import TappedLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.setpoints import PositionSetpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Pose, norm, subtract

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
POSITION = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
SET_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
START = Pose.of(2.0, -1.0, 0.0, yaw_rad=0.7)
Script = Callable[[Driver, EmbeddedVehicle], Awaitable[Any]]


def _fly(autopilot: str, script: Script, *, latency_s: float = 0.002, **options: Any) -> Any:
    async def fly() -> Any:
        ours, theirs = memory_pair(latency_s=latency_s)
        config = EmbeddedConfig(autopilot=autopilot, start=START, **options)
        async with (
            EmbeddedVehicle(config=config, link=theirs, seed=1) as vehicle,
            Driver(name="real", link=ours, start=START) as driver,
        ):
            return await script(driver, vehicle)

    return run_virtual(fly())


async def _up(driver: Driver, altitude_m: float) -> None:
    await driver.identify(5.0)
    await driver.ready(90.0)
    await driver.arm()
    await driver.begin_takeoff(altitude_m)

    def there() -> bool:
        estimate = driver.state.estimate
        return estimate is not None and -estimate.pose.position_ned_m[2] > altitude_m - 0.15

    await _until(there, 30.0)


async def _until(condition: Callable[[], bool], timeout_s: float) -> None:
    for _ in range(round(timeout_s * 20)):
        if condition():
            return
        await asyncio.sleep(0.05)
    raise AssertionError(f"not within {timeout_s} s")


async def _stream(driver: Driver, setpoint: Any, seconds: float) -> None:
    for _ in range(round(seconds * 20)):
        driver.send(setpoint)
        await asyncio.sleep(0.05)


@BOTH
def test_the_driver_flies_and_reports_a_whole_flight(autopilot: str) -> None:
    events: list[VehicleEvent] = []
    samples: list[tuple[EstimateSample, Any]] = []

    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> Driver:
        driver.on_event(events.append)
        driver.on_estimate(lambda sample: samples.append((sample, vehicle.truth())))
        await _up(driver, 1.5)
        await asyncio.sleep(2.0)
        await driver.enter_guided()
        await _stream(driver, VelocitySetpoint((0.0, 1.0, 0.0)), 4.0)
        flown = vehicle.truth().pose
        # A metre per second along the world's east, wherever the nose points.
        assert 2.5 < flown.position_ned_m[1] - START.position_ned_m[1] < 4.5
        assert abs(flown.position_ned_m[0] - START.position_ned_m[0]) < 0.3
        assert abs(flown.yaw_rad - START.yaw_rad) < 0.1
        await _stream(driver, PositionSetpoint((2.0, -1.0, -2.0), yaw_rad=-0.5), 8.0)
        there = vehicle.truth().pose
        assert norm(subtract(there.position_ned_m, (2.0, -1.0, -2.0))) < 0.4
        assert abs(there.yaw_rad + 0.5) < 0.1
        await driver.hold()
        await driver.land()
        await driver.disarmed(40.0)
        return driver

    driver = _fly(autopilot, script)
    assert driver.identity.autopilot == autopilot
    assert not driver.state.armed
    assert driver.state.landed == "on_ground"
    kinds = [each.kind for each in events]
    assert kinds.index("armed") < kinds.index("disarmed")
    landed = [each.text for each in events if each.kind == "landed_state"]
    assert landed == ["on_ground", "taking_off", "in_air", "landing", "on_ground"]
    surprises = [each for each in events if each.kind == "mode" and not each.asked]
    # Only the mode in which ArduCopter booted.
    assert [each.text for each in surprises] == (["STABILIZE"] if autopilot == "ardupilot" else [])
    assert not {"failsafe", "fault", "link_lost", "reboot"} & set(kinds)


def test_a_vehicle_that_stays_armed_after_its_landing_is_commanded_to_disarm() -> None:
    """COM_DISARM_LAND of -1: it was armed for 60 s, and every flight an ERROR."""

    async def script(driver: Driver, _: EmbeddedVehicle) -> float:
        await _up(driver, 1.2)
        await driver.land()
        await _until(lambda: driver.state.landed == "on_ground", 20.0)
        landed_s = asyncio.get_running_loop().time()
        await driver.disarmed(40.0)
        return asyncio.get_running_loop().time() - landed_s

    took_s = _fly("px4", script, parameters={"COM_DISARM_LAND": -1.0})
    assert 5.0 <= took_s < 7.0


@BOTH
def test_estimates_come_at_their_rate_and_are_true(autopilot: str) -> None:
    samples: list[EstimateSample] = []
    truths: list[Any] = []

    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        vehicle.on_truth(truths.append, 250.0)
        await _up(driver, 1.5)
        driver.on_estimate(samples.append)
        await asyncio.sleep(1.0)
        await driver.enter_guided()
        await _stream(driver, VelocitySetpoint((1.0, 0.0, 0.0)), 4.0)

    _fly(autopilot, script)
    steps_s = [after.t_s - before.t_s for before, after in itertools.pairwise(samples)]
    assert len(steps_s) / sum(steps_s) == pytest.approx(50.0, rel=0.05)
    assert max(steps_s) < 0.05
    true_at = {round(truth.t_s * 250): truth.pose.position_ned_m for truth in truths}
    errors_m = [
        norm(subtract(sample.pose.position_ned_m, true_at[round(sample.t_s * 250)]))
        for sample in samples
    ]
    assert max(errors_m) < 0.3
    # At 1 m/s a wrong time of 10 ms is 10 mm; the rest is the estimator's own noise.
    assert all(0.0 <= sample.arrived_s - sample.t_s < 0.05 for sample in samples)


@BOTH
@pytest.mark.parametrize("latency_s", [0.0, 0.1])
def test_flies_whatever_the_latency(autopilot: str, latency_s: float) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> float:
        await _up(driver, 1.2)
        await driver.enter_guided()
        estimate = driver.clock.estimate()
        assert estimate is not None
        assert estimate.resets == 0
        await driver.land()
        await driver.disarmed(40.0)
        now_s = asyncio.get_running_loop().time()
        return abs(driver.clock.run_time(driver.clock.boot_time(now_s)) - now_s)

    assert _fly(autopilot, script, latency_s=latency_s) < 1e-6


@BOTH
def test_a_landed_vehicle_gets_ready_again_where_it_stands(autopilot: str) -> None:
    async def script(driver: Driver, _: EmbeddedVehicle) -> None:
        for _turn in range(2):
            await _up(driver, 1.0)
            await driver.enter_guided()
            driver.send(VelocitySetpoint((0.5, 0.0, 0.0)))
            await asyncio.sleep(1.0)
            await driver.land()
            await driver.disarmed(60.0)

    # PX4 that landed in OFFBOARD is in it again, and has to be asked out of it.
    _fly(autopilot, script)


@BOTH
def test_a_vehicle_that_is_never_ready_is_an_error(autopilot: str) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        await driver.identify(5.0)
        with pytest.raises(NotReadyError, match="pre-arm checks have not passed") as caught:
            await driver.ready(60.0)
        assert caught.value.texts

    _fly(autopilot, script, never_ready=True)


@BOTH
def test_refused_arming(autopilot: str) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        await driver.identify(5.0)
        await driver.ready(60.0)
        with pytest.raises(ArmRefusedError, match="Motor 3 is warm") as caught:
            await driver.arm()
        assert any("Motor 3 is warm" in reason for reason in caught.value.reasons)

    _fly(autopilot, script, refuse_arm="Motor 3 is warm")


@BOTH
def test_parameters_are_set_read_and_refused(autopilot: str) -> None:
    whole, real = {
        "px4": ("NAV_DLL_ACT", "COM_OF_LOSS_T"),
        "ardupilot": ("FS_GCS_ENABLE", "GUID_TIMEOUT"),
    }[autopilot]

    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        await driver.identify(5.0)
        for name, value in ((whole, 2), (real, 1.5)):
            await driver.parameters.set(name, value)
            back = await driver.parameters.get(name)
            assert back == value
            assert type(back) is type(value)
        with pytest.raises(ParameterError, match="NO_SUCH"):
            await driver.parameters.get("NO_SUCH")

    _fly(autopilot, script)


@pytest.mark.parametrize("cut_hz", [None, 3])
@BOTH
def test_rates_that_a_ground_station_cuts_are_restored(autopilot: str, cut_hz: int | None) -> None:
    """And nothing is asked for where all is in time. PX4 ignores REQUEST_DATA_STREAM."""
    asked: list[float] = []

    async def fly() -> tuple[int, int]:
        ours, theirs = memory_pair(latency_s=0.002)
        reader = MavlinkCodec(system_id=1, component_id=1)

        def note(data: bytes, _: float) -> None:
            asked.extend(
                message.param1
                for message in reader.parse(data)
                if message.get_type() == "COMMAND_LONG" and message.command == SET_INTERVAL
            )

        link = TappedLink(theirs)
        link.tap(note)
        config = EmbeddedConfig(autopilot=autopilot, start=START)
        async with (
            EmbeddedVehicle(config=config, link=link, seed=1),
            Driver(name="real", link=ours, start=START) as driver,
        ):
            arrived: list[float] = []
            await driver.identify(5.0)
            await driver.ready(90.0)
            driver.on_message(POSITION, lambda _, t_s: arrived.append(t_s))
            asked.clear()
            if cut_hz is not None:
                driver.send_message(
                    mavlink.MAVLink_request_data_stream_message(
                        1, 1, mavlink.MAV_DATA_STREAM_POSITION, cut_hz, 1
                    )
                )
            await asyncio.sleep(1.0)
            first = len(arrived)
            await asyncio.sleep(20.0)
            now_s = asyncio.get_running_loop().time()
            return first, sum(t_s > now_s - 1.0 for t_s in arrived)

    before, after = run_virtual(fly())
    is_cut = cut_hz is not None and autopilot == "ardupilot"
    assert (before < 10) == is_cut
    assert after == pytest.approx(50, abs=2)
    assert set(asked) == ({float(POSITION)} if is_cut else set())


def test_arming_asks_at_once_for_positions_that_a_ground_station_cut() -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> float:
        loop = asyncio.get_running_loop()
        await driver.identify(5.0)
        await driver.ready(90.0)
        driver.send_message(
            mavlink.MAVLink_request_data_stream_message(
                1, 1, mavlink.MAV_DATA_STREAM_POSITION, 1, 1
            )
        )
        await asyncio.sleep(1.2)
        began_s = loop.time()
        await driver.arm()
        return loop.time() - began_s

    assert _fly("ardupilot", script) < 2.0


def test_takeoff_disarmed_is_refused() -> None:
    # PX4 takes it, and takes off once it is armed (the reference flight).
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        await driver.identify(5.0)
        await driver.ready(60.0)
        with pytest.raises(CommandError, match="MAV_CMD_NAV_TAKEOFF"):
            await driver.begin_takeoff(2.0)

    _fly("ardupilot", script)


@BOTH
def test_a_dead_vehicle_is_reported(autopilot: str) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> list[VehicleEvent]:
        events: list[VehicleEvent] = []
        await _up(driver, 1.2)
        driver.on_event(events.append)
        vehicle.kill()
        with pytest.raises(CommandError, match="nothing received for"):
            await driver.land()
        return events

    assert [each.kind for each in _fly(autopilot, script)] == ["link_lost"]


@BOTH
def test_terminate_stops_the_motors(autopilot: str) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        await _up(driver, 1.2)
        await driver.terminate()
        await _until(lambda: vehicle.truth().pose.position_ned_m[2] > -0.2, 2.0)

    _fly(autopilot, script)


def test_wrong_autopilot() -> None:
    async def fly() -> None:
        ours, theirs = memory_pair()
        config = EmbeddedConfig(autopilot="px4")
        async with (
            EmbeddedVehicle(config=config, link=theirs, seed=1),
            Driver(name="real", link=ours, autopilot="ardupilot") as driver,
        ):
            await driver.identify(5.0)

    with pytest.raises(IdentifyError, match="is px4, and ardupilot was requested"):
        run_virtual(fly())


def test_two_vehicles_get_their_takeoff_in_one_turn() -> None:
    async def fly() -> float:
        starts = (Pose.of(0.0, 0.0, 0.0), Pose.of(5.0, 0.0, 0.0))
        links = [memory_pair(), memory_pair()]
        vehicles = [
            EmbeddedVehicle(
                config=EmbeddedConfig(autopilot="px4", start=start, system_id=number + 1),
                link=link[1],
                seed=number,
            )
            for number, (start, link) in enumerate(zip(starts, links, strict=True))
        ]
        drivers = [
            Driver(name=f"vehicle {number}", link=link[0], start=start)
            for number, (start, link) in enumerate(zip(starts, links, strict=True))
        ]
        off: dict[str, float] = {}

        def note(name: str) -> Callable[[VehicleEvent], None]:
            def listen(event: VehicleEvent) -> None:
                if event.kind == "landed_state" and event.text == "taking_off":
                    off[name] = event.t_s

            return listen

        async with vehicles[0], vehicles[1], drivers[0], drivers[1]:
            for driver in drivers:
                driver.on_event(note(driver.name))
            await asyncio.gather(*(driver.identify(5.0) for driver in drivers))
            await asyncio.gather(*(driver.ready(60.0) for driver in drivers))
            await asyncio.gather(*(driver.arm() for driver in drivers))
            await asyncio.gather(*[driver.begin_takeoff(1.5) for driver in drivers])
            await asyncio.sleep(6.0)
            for driver, start in zip(drivers, starts, strict=True):
                estimate = driver.state.estimate
                assert estimate is not None
                north_m, east_m, down_m = estimate.pose.position_ned_m
                assert math.hypot(north_m - start.position_ned_m[0], east_m) < 0.5
                assert -down_m == pytest.approx(1.5, abs=0.3)
        return abs(off["vehicle 0"] - off["vehicle 1"])

    assert run_virtual(fly()) < 0.3


def test_the_same_seed_gives_the_same_flight() -> None:
    def fly() -> list[EstimateSample]:
        samples: list[EstimateSample] = []

        async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
            driver.on_estimate(samples.append)
            await _up(driver, 1.2)

        _fly("px4", script)
        return samples

    first = fly()
    assert first == fly()
    assert len(first) > 100


@BOTH
async def test_over_udp_on_the_wall_clock(autopilot: str) -> None:
    port = free_port()
    ours = open_link(parse_link(f"udpin://127.0.0.1:{port}"))
    theirs = open_link(parse_link(f"udpout://127.0.0.1:{port}"))
    config = EmbeddedConfig(autopilot=autopilot)
    async with (
        Driver(name="real", link=ours) as driver,
        EmbeddedVehicle(config=config, link=theirs, seed=1),
    ):
        identity = await driver.identify(60.0)
        assert identity.autopilot == autopilot
        name = "COM_OF_LOSS_T" if autopilot == "px4" else "GUID_TIMEOUT"
        await driver.parameters.set(name, 2.0)
        await _until(lambda: driver.state.battery is not None and driver.clock.synchronised, 60.0)
        # A busy machine answers late: the first round trips tell less.
        await _until(lambda: (driver.clock.uncertainty_s or 9.0) < 0.1, 60.0)
