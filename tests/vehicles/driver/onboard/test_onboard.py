"""Fences, missions, parameters and logs on board: both autopilots, in memory, over a bad radio
and over UDP."""

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import DFReader
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pyulog import ULog

from tests.ports import free_port
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.impaired_links.impaired import ImpairedLink
from wil_campaign.plugins.impaired_links.impairment import Impairment
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.onboard.fence_protocol import AutopilotFence
from wil_campaign.vehicles.driver.onboard.mission_protocol import (
    ItemList,
    MissionError,
    MissionItem,
)
from wil_campaign.vehicles.driver.onboard.onboard_fence import OnboardFence
from wil_campaign.vehicles.driver.onboard.vehicle_logs import LogEntry, VehicleLogError, VehicleLogs
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.errors import ParameterError
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.fence_areas import FenceCircle, FencePlace, FencePolygon

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
GOOD = Impairment()
BAD = Impairment(latency_s=0.08, jitter_s=0.04, loss=0.08, duplicate=0.05)
Script = Callable[[Driver, EmbeddedVehicle], Awaitable[Any]]

HOME = FencePlace(47.397742, 8.545594)
STEP_DEG = 1e-4
AROUND = FencePolygon(
    tuple(
        FencePlace(HOME.latitude_deg + north * STEP_DEG, HOME.longitude_deg + east * STEP_DEG)
        for north, east in ((3, 3), (3, -3), (-3, -3), (-3, 3))
    )
)
TREE = FenceCircle(FencePlace(HOME.latitude_deg + STEP_DEG, HOME.longitude_deg), 2.0, inside=False)
ELSEWHERE = FenceCircle(FencePlace(HOME.latitude_deg + 0.1, HOME.longitude_deg), 5.0)
ROUTE = tuple(
    MissionItem(
        command=mavlink.MAV_CMD_NAV_WAYPOINT,
        params=(0.0, 0.0, 0.0, math.nan),
        x=round((HOME.latitude_deg + number * STEP_DEG) * 1e7),
        y=round(HOME.longitude_deg * 1e7),
        z=2.0 + number,
    )
    for number in range(4)
)


def _words(value: Impairment | int) -> str:
    return str(value) if isinstance(value, int) else "good" if value == GOOD else "bad"


def _on_board(autopilot: str, script: Script, *, bad: Impairment = GOOD, seed: int = 1) -> Any:
    async def fly() -> Any:
        ours, theirs = memory_pair(latency_s=0.003)
        link = ImpairedLink(link=ours, outgoing=bad, incoming=bad, rng=np.random.default_rng(seed))
        async with (
            EmbeddedVehicle(
                config=EmbeddedConfig(autopilot=autopilot), link=theirs, seed=seed
            ) as vehicle,
            Driver(name="real", link=link) as driver,
        ):
            await driver.identify(8.0)
            return await script(driver, vehicle)

    return run_virtual(fly())


@asynccontextmanager
async def kept_by(driver: Driver, fence: AutopilotFence) -> AsyncIterator[OnboardFence]:
    kept = OnboardFence(
        fences=driver.onboard.fences,
        parameters=driver.parameters,
        autopilot=driver.identity.autopilot,
    )
    async with kept:
        await kept.keep(fence)
        yield kept


def _near(areas: tuple[Any, ...], wanted: tuple[Any, ...]) -> bool:
    """Whether areas are the wanted ones, to the 1e-7 degrees of the wire."""

    def places(area: Any) -> list[float]:
        corners = area.corners if isinstance(area, FencePolygon) else (area.centre,)
        return [value for each in corners for value in (each.latitude_deg, each.longitude_deg)]

    return [(type(each), each.inside) for each in areas] == [
        (type(each), each.inside) for each in wanted
    ] and all(
        places(one) == pytest.approx(places(other), abs=2e-7)
        for one, other in zip(areas, wanted, strict=True)
    )


async def _fence(driver: Driver, vehicle: EmbeddedVehicle) -> None:
    name = driver.identity.autopilot
    action = "GF_ACTION" if name == "px4" else "FENCE_ACTION"
    before = vehicle.autopilot.parameters[action]
    fence = AutopilotFence(areas=(AROUND, TREE), ceiling_m=12.0, action="land")
    async with kept_by(driver, fence):
        assert _near(await driver.onboard.fences.read(), (AROUND, TREE))
        assert vehicle.autopilot.parameters[action] == (5 if name == "px4" else 2)
        top = "GF_MAX_VER_DIST" if name == "px4" else "FENCE_ALT_MAX"
        assert vehicle.autopilot.parameters[top] == 12.0
        drawn = vehicle.autopilot.fence
        assert not drawn.breached(5.0, 0.0)
        assert drawn.breached(11.0, 0.0)
        assert drawn.breached(50.0, 0.0)
    assert await driver.onboard.fences.read() == ()
    assert vehicle.autopilot.parameters[action] == before


async def _mission(driver: Driver, vehicle: EmbeddedVehicle) -> None:
    missions = driver.onboard.missions
    await missions.upload(ItemList.MISSION, ROUTE)
    back = await missions.download(ItemList.MISSION)
    assert [(item.x, item.z) for item in back] == [(item.x, item.z) for item in ROUTE]
    await missions.clear(ItemList.MISSION)
    assert await missions.download(ItemList.MISSION) == ()


async def _changed_parameters(driver: Driver, vehicle: EmbeddedVehicle) -> None:
    px4 = driver.identity.autopilot == "px4"
    changes = (
        {"COM_OF_LOSS_T": 2.1, "GF_ACTION": 5} if px4 else {"GUID_TIMEOUT": 2.1, "FENCE_ACTION": 2}
    )
    before = {name: vehicle.autopilot.parameters[name] for name in changes}
    async with driver.parameters.changed(changes):
        for name, value in changes.items():
            assert vehicle.autopilot.parameters[name] == pytest.approx(value)
    assert {name: vehicle.autopilot.parameters[name] for name in changes} == before


async def _everything(driver: Driver, vehicle: EmbeddedVehicle) -> None:
    await _fence(driver, vehicle)
    await _mission(driver, vehicle)
    await _changed_parameters(driver, vehicle)


@BOTH
@pytest.mark.parametrize(
    ("bad", "seed"), [(GOOD, 1), *((BAD, seed) for seed in (1, 2, 3, 4))], ids=_words
)
def test_fence_mission_and_parameters_are_written_and_read_back(
    autopilot: str, bad: Impairment, seed: int
) -> None:
    _on_board(autopilot, _everything, bad=bad, seed=seed)


@BOTH
async def test_fence_mission_and_parameters_work_over_udp_on_the_wall_clock(
    autopilot: str, tmp_path: Path
) -> None:
    port = free_port()
    ours = open_link(parse_link(f"udpin://127.0.0.1:{port}"))
    theirs = open_link(parse_link(f"udpout://127.0.0.1:{port}"))
    async with (
        Driver(name="real", link=ours) as driver,
        EmbeddedVehicle(config=EmbeddedConfig(autopilot=autopilot), link=theirs, seed=1) as vehicle,
    ):
        await driver.identify(10.0)
        await _everything(driver, vehicle)
        _write_log(vehicle, seconds=30.0)
        (entry,) = await driver.onboard.logs.list()
        file = await driver.onboard.logs.fetch(entry, tmp_path)
    assert file.stat().st_size == entry.size_bytes > 1000


def _write_log(vehicle: EmbeddedVehicle, *, seconds: float) -> None:
    """Have the autopilot write a log without flying: of a vehicle that stands."""
    logs, now = vehicle.autopilot.logs, vehicle.autopilot.state.now
    for tick in range(round(seconds * 5)):
        logs.turn(100.0 + 0.2 * tick, armed=True, now=now)
    logs.turn(100.0 + seconds, armed=False, now=now)


@BOTH
def test_a_fence_that_leaves_home_out_is_refused_or_keeps_it_on_the_ground(
    autopilot: str,
) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        fences = driver.onboard.fences
        await driver.ready(90.0)
        if autopilot == "px4":
            with pytest.raises(MissionError, match="fence: it was refused with MAV_MISSION_DENIED"):
                await fences.upload((ELSEWHERE,))
            assert await fences.read() == ()
            return
        async with kept_by(driver, AutopilotFence(areas=(ELSEWHERE,))):
            assert _near(await fences.read(), (ELSEWHERE,))
            assert vehicle.autopilot.fence.breached(0.0, 0.0)
        assert await fences.read() == ()

    _on_board(autopilot, script)


@BOTH
def test_the_fence_that_was_there_is_there_again(autopilot: str) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        fences = driver.onboard.fences
        await fences.upload((AROUND,))
        async with kept_by(driver, AutopilotFence(areas=(AROUND, TREE))):
            assert _near(await fences.read(), (AROUND, TREE))
        assert _near(await fences.read(), (AROUND,))

    _on_board(autopilot, script)


def test_a_fence_is_set_back_when_its_parameters_are_refused() -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        # An autopilot of another version, where the parameter has another name.
        await asyncio.sleep(1.0)  # until the list that the driver requests has been sent
        vehicle.autopilot.parameters._entries.pop("FENCE_ALT_MAX")
        fence = AutopilotFence(areas=(AROUND,), ceiling_m=10.0)
        with pytest.raises(ParameterError, match="FENCE_ALT_MAX"):
            async with kept_by(driver, fence):
                raise AssertionError("entered with half a fence")
        assert await driver.onboard.fences.read() == ()
        assert vehicle.autopilot.parameters["FENCE_ENABLE"] == 0

    _on_board("ardupilot", script)


@BOTH
@pytest.mark.parametrize(("bad", "seed"), [(GOOD, 1), (BAD, 1), (BAD, 2)], ids=_words)
def test_logs_of_a_flight_are_whole(
    autopilot: str, tmp_path: Path, bad: Impairment, seed: int
) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> tuple[Path, bytes]:
        assert await driver.onboard.logs.list() == ()
        await driver.ready(90.0)
        await driver.arm()
        await driver.begin_takeoff(1.5)
        await asyncio.sleep(6.0)
        await driver.land()
        await driver.disarmed(40.0)
        (entry,) = await driver.onboard.logs.list()
        came: list[int] = []
        file = await driver.onboard.logs.fetch(entry, tmp_path, name="real", progress=came.append)
        assert came[-1] == entry.size_bytes
        return file, vehicle.autopilot.logs._logs[entry.number]

    file, on_board = _on_board(autopilot, script, bad=bad, seed=seed)
    assert file.read_bytes() == on_board
    assert list(tmp_path.iterdir()) == [file]
    if autopilot == "px4":
        assert file.name == "real-0.ulg"
        _look_into_ulog(file)
    else:
        assert file.name == "real-1.bin"
        _look_into_dataflash(file)


def _look_into_ulog(file: Path) -> None:
    log = ULog(str(file))
    assert not log.file_corruption
    (topic,) = log.data_list
    assert topic.name == "vehicle_local_position"
    assert min(topic.data["z"]) == pytest.approx(-1.5, abs=0.3)
    assert [each.message for each in log.logged_messages] == ["armed", "disarmed"]
    assert log.initial_parameters["COM_OF_LOSS_T"] == 1.0
    assert log.initial_parameters["GF_ACTION"] == 2


def _look_into_dataflash(file: Path) -> None:
    log = DFReader.DFReader_binary(str(file))
    lowest, parameters, words = 0.0, {}, []
    while (message := log.recv_msg()) is not None:
        if message.get_type() == "XKF1":
            lowest = min(lowest, message.PD)
        elif message.get_type() == "PARM":
            parameters[message.Name] = message.Value
        elif message.get_type() == "MSG":
            words.append(message.Message)
    log.close()
    assert lowest == pytest.approx(-1.5, abs=0.3)
    assert parameters["GUID_TIMEOUT"] == 3.0
    assert words == ["armed", "disarmed"]


def test_a_log_that_stops_half_way_leaves_nothing_behind(tmp_path: Path) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        _write_log(vehicle, seconds=900.0)
        (entry,) = await driver.onboard.logs.list()

        def stop(received: int) -> None:
            vehicle.mute(muted=True)

        with pytest.raises(VehicleLogError, match=r"log 0 stopped at \d+ of \d+ bytes"):
            await driver.onboard.logs.fetch(entry, tmp_path, progress=stop)

    _on_board("px4", script)
    assert list(tmp_path.iterdir()) == []


def test_a_log_that_cannot_be_written_says_where(tmp_path: Path) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        _write_log(vehicle, seconds=10.0)
        (entry,) = await driver.onboard.logs.list()
        with pytest.raises(VehicleLogError, match=r"log 0 to .*away/log-0.ulg: No such file"):
            await driver.onboard.logs.fetch(entry, tmp_path / "away")

    _on_board("px4", script)


def test_errors_before_the_vehicle_is_known() -> None:
    async def scenario() -> None:
        ours, _ = memory_pair()
        driver = Driver(name="real", link=ours)
        with pytest.raises(MissionError, match="identified"):
            await driver.onboard.missions.download(ItemList.FENCE)
        with pytest.raises(VehicleLogError, match="identified"):
            await driver.onboard.logs.list()

    run_virtual(scenario())


@pytest.mark.parametrize(
    "make",
    [
        lambda: FencePolygon((HOME, HOME)),
        lambda: FenceCircle(HOME, 0.0),
        lambda: FenceCircle(HOME, math.nan),
        AutopilotFence,
        lambda: AutopilotFence(ceiling_m=-1.0),
    ],
)
def test_an_impossible_fence_is_refused(make: Callable[[], Any]) -> None:
    with pytest.raises(ValueError, match="fence"):
        make()


def test_a_log_of_an_unidentified_vehicle_leaves_no_file(tmp_path: Path) -> None:
    async def fetch() -> None:
        near, _ = memory_pair(latency_s=0.003)
        logs = VehicleLogs(session=MavlinkSession(link=near, own=MavlinkTarget(245, 190)))
        await logs.fetch(LogEntry(1, 1000, None), tmp_path)

    with pytest.raises(VehicleLogError, match="no vehicle is identified yet"):
        run_virtual(fetch())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("size_bytes", [0, 1000])
def test_an_empty_log_is_no_file(
    fake_pair: Callable[..., Any], size_bytes: int, tmp_path: Path
) -> None:
    """One that its entry says is empty, and one that ends before its first byte."""

    def end_at_once(peer: Any, message: Any) -> None:
        peer.say(mavlink.MAVLink_log_data_message(message.id, 0, 0, [0] * 90))

    async def fetch() -> None:
        ours, peer = fake_pair()
        session = MavlinkSession(link=ours, own=MavlinkTarget(245, 190))
        session.target = MavlinkTarget(1, 1)
        peer.replies["LOG_REQUEST_DATA"] = end_at_once
        async with peer, ours:
            await VehicleLogs(session=session).fetch(LogEntry(3, size_bytes, None), tmp_path)

    with pytest.raises(VehicleLogError, match="log 3 is empty"):
        run_virtual(fetch())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("in_order", "oldest_first"), [(True, [0, 1, 2, 3]), (False, [0, 3, 1, 2])]
)
def test_the_newest_log_is_the_last(
    fake_pair: Callable[..., Any], in_order: bool, oldest_first: list[int]
) -> None:
    """PX4 numbers its logs in the order of a directory; ArduPilot may not know the time."""
    times_s = {0: 0, 1: 1_700_000_200, 2: 1_700_000_300, 3: 1_700_000_100}

    def say_logs(peer: Any, _: Any) -> None:
        for number, utc_s in times_s.items():
            peer.say(mavlink.MAVLink_log_entry_message(number, len(times_s), 3, utc_s, 1000))

    async def newest() -> list[int]:
        ours, peer = fake_pair()
        session = MavlinkSession(link=ours, own=MavlinkTarget(245, 190))
        session.target = MavlinkTarget(1, 1)
        peer.replies["LOG_REQUEST_LIST"] = say_logs
        logs = VehicleLogs(session=session)
        logs.use_format(".log", numbered_in_order=in_order)
        async with peer, ours:
            return [entry.number for entry in await logs.list()]

    assert run_virtual(newest()) == oldest_first


@pytest.mark.parametrize("what", ["upload", "clear"])
def test_a_list_whose_reading_never_ended_does_not_keep_px4_from_the_next_one(what: str) -> None:
    """As when a radio loses the last MISSION_ACK of a download: PX4 is busy for 5 s."""

    async def script(driver: Driver, vehicle: EmbeddedVehicle) -> None:
        missions = driver.onboard.missions
        await missions.upload(ItemList.MISSION, ROUTE)
        driver.send_message(mavlink.MAVLink_mission_request_list_message(1, 1, ItemList.MISSION))
        await asyncio.sleep(0.1)
        if what == "clear":
            await missions.clear(ItemList.MISSION)
        else:
            await missions.upload(ItemList.MISSION, ROUTE[:2])
        left = vehicle.autopilot.missions.items
        assert len(left) == (0 if what == "clear" else 2)

    _on_board("px4", script)
