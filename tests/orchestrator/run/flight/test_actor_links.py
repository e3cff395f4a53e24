"""Launched and attached actors over sockets, flown by the program: the wall clock runs."""

import asyncio
import json
import os
import signal
import socket
from asyncio.subprocess import Process
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.sitl_programs import make_arducopter
from tests.orchestrator.wall_runs import Landed, Program, lines, until
from tests.ports import free_port
from tests.vehicles.embedded.running_vehicle import running_vehicle
from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings, Start
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link

AVOID = ("avoid", "fast")
BLIND = "autonomy.with={object: person}"
PATIENT = "max_offset_m: 5, max_delay_s: 60, max_silence_s: 2.5"
FENCE = "geofence: {box: {north_m: [-1.5, 3.5], east_m: [-1.5, 1.5], up_m: [-0.5, 2.3]}}"
ANSWERED = "preflight.override={separation: A. Pilot}"


def words(*sets: str) -> list[str]:
    given = ("controls={}", BLIND, "oracles.geofence.required=false", *sets)
    return [word for one in given for word in ("--set", one)]


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@asynccontextmanager
async def vehicle(port: int, *, system_id: int, start: Start) -> AsyncIterator[Process]:
    """A vehicle that is there before the program is, and after it."""
    settings = ProcessSettings(
        autopilot="px4",
        link=f"udpout://127.0.0.1:{port}",
        seed=system_id,
        running_s=60.0,
        system_id=system_id,
        start=start,
        latitude_deg=47.397742,
        longitude_deg=8.545594,
        altitude_m=488.0,
    )
    async with running_vehicle(settings) as process:
        yield process


class Hall:
    """A real vehicle and an intruder, both attached, that fly beside each other in mode real."""

    def __init__(self, stack: AsyncExitStack) -> None:
        self._stack = stack
        self.ports = {"real": free_port(), "intruder": free_port()}

    async def open(self) -> None:
        places = {
            "real": (1, Start()),
            "intruder": (3, Start(north_m=2.5, up_m=0.05, yaw_deg=180.0)),
        }
        self.processes = {
            name: await self._stack.enter_async_context(
                vehicle(self.ports[name], system_id=number, start=start)
            )
            for name, (number, start) in places.items()
        }

        await asyncio.gather(*map(_first_word, self.ports.values()))

    @property
    def sets(self) -> list[str]:
        link = f"udpin://127.0.0.1:{self.ports['intruder']}"
        return words(
            f"vehicles.real.link=udpin://127.0.0.1:{self.ports['real']}",
            "vehicles.real.pose_source=mavlink",
            "modes=[real]",
            "accept={fast: {real: 5/5}}",
            "cases={fast: {}}",
            f"actors={{intruder: {{link: '{link}', autopilot: px4, {PATIENT}, {FENCE}}}}}",
            "preflight.failsafe=set",
            "actors.intruder.params={COM_OF_LOSS_T: 2.5}",
            ANSWERED,
        )

    async def stands(self, name: str, *, restored: bool = True) -> None:
        """A vehicle is disarmed on the ground, and has its own parameters again.

        While it may be in the air a guard holds its port, also one without a program.
        """
        port = self.ports[name]
        await until(lambda: _is_free(port), 150.0)
        async with Driver(name=name, link=open_link(parse_link(f"udpin://127.0.0.1:{port}"))) as it:
            await it.identify(20.0)
            await until(lambda: it.state.landed == "on_ground", 20.0)
            assert not it.state.armed
            if restored:
                assert await it.parameters.get("COM_OF_LOSS_T") == 1.0


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


async def _first_word(port: int) -> None:
    """Wait until a vehicle sends to a port: its process has started then."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
        here.setblocking(False)
        here.bind(("127.0.0.1", port))
        async with asyncio.timeout(90.0):
            await asyncio.get_running_loop().sock_recv(here, 2048)


@asynccontextmanager
async def hall() -> AsyncIterator[Hall]:
    async with AsyncExitStack() as stack:
        made = Hall(stack)
        await made.open()
        yield made


def run_of(landed: Landed) -> dict[str, Any]:
    (run,) = json.loads(landed.out)["runs"]
    assert isinstance(run, dict)
    return run


async def test_a_launched_actor_moves_its_object_by_its_ground_truth(tmp_path: Path) -> None:
    link = f"{{launch: ardupilot, binary: {make_arducopter(tmp_path)}, speedup: 2}}"
    actor = f"actors={{intruder: {{link: {link}, autopilot: ardupilot, {PATIENT}, {FENCE}}}}}"
    sets = words(actor, "world.objects.intruder.motion.start.delay_s=6")
    arguments = ("--mode", "sim", "--json", *sets)
    async with Program(tmp_path / "out", *arguments, clock=None, flown=AVOID) as program:
        landed = await program.end()
        run, folder = run_of(landed), program.run_folder("sim")
    assert json.loads(landed.out)["clock"] == "scaled"
    assert (run["verdict"], run["decided_by"]) == ("FAIL", "collision/twin"), landed.why
    (actor_result,) = run["actors"]
    assert (actor_result["flown_by"], actor_result["pose_source"]) == ("launched", "simulator")
    assert actor_result["offset_m"] < 1.0
    started = [line for line in lines(folder / "guard.jsonl") if line["event"] == "started"]
    pids = {line["vehicle"]: line["pid"] for line in started}
    assert set(pids) == {"twin", "intruder"}
    assert ProcessId.of(pids["intruder"]) is None
    checked = {(one["check"], one["vehicle"]) for one in run["preflight"]}
    assert {("ground_truth", "intruder"), ("home", "intruder")} <= checked
    assert (folder / "intruder.tlog").stat().st_size > 0


async def test_an_attached_actor_at_another_place_flies_the_way_of_its_object(
    tmp_path: Path,
) -> None:
    port = free_port()
    link = f"udpin://127.0.0.1:{port}"
    elsewhere = "virtual: {place: {north_m: 30, east_m: 5, yaw_deg: 90}}"
    actor = f"{{link: '{link}', autopilot: px4, pose_source: simulator, {PATIENT}, {FENCE}"
    sets = words(f"actors={{intruder: {actor}, {elsewhere}}}}}", "preflight.failsafe=set")
    given = ("--mode", "sim", "--json", *sets, "--arm-actors")
    start = Start(north_m=30.0, east_m=5.0, yaw_deg=90.0)
    async with vehicle(port, system_id=3, start=start):
        await _first_word(port)
        async with Program(tmp_path / "out", *given, flown=AVOID) as program:
            landed = await program.end()
    run = run_of(landed)
    assert (run["verdict"], run["decided_by"]) == ("FAIL", "collision/twin"), landed.why
    assert landed.err.startswith("intruder: px4 ")
    (result,) = run["actors"]
    assert (result["flown_by"], result["pose_source"]) == ("attached", "simulator")
    assert result["offset_m"] < 1.0


@pytest.mark.no_turn("flies nothing")
async def test_an_attached_actor_is_not_armed_by_the_word_for_the_vehicle(tmp_path: Path) -> None:
    async with AsyncExitStack() as stack:
        given = ("--mode", "real", "--json", *Hall(stack).sets, "--arm-real")
        # Nobody is there: it is refused before anything is asked of a vehicle.
        async with Program(tmp_path / "no", *given, flown=AVOID) as program:
            refused = await program.end()
    assert refused.code == 2, refused.why
    assert "armed only with --arm-actors" in refused.err


async def test_an_attached_actor_flies_at_an_attached_vehicle_by_two_words(tmp_path: Path) -> None:
    async with hall() as there:
        both = ("--mode", "real", "--json", *there.sets, "--arm-real", "--arm-actors")
        async with Program(tmp_path / "out", *both, flown=AVOID) as program:
            landed = await program.end()
        run = run_of(landed)
        assert (run["verdict"], run["decided_by"]) == ("FAIL", "collision/real"), landed.why
        await asyncio.gather(there.stands("real"), there.stands("intruder"))
    (actor,) = run["actors"]
    assert (actor["flown_by"], actor["pose_source"]) == ("attached", "mavlink")
    items = {one["check"]: one for one in run["preflight"] if one["vehicle"] == "intruder"}
    assert (items["separation"]["outcome"], items["separation"]["by"]) == ("overridden", "A. Pilot")
    assert items["distance"]["outcome"] == "ok"
    caveats = json.loads(landed.out)["caveats"]
    assert any("at its own position estimate" in caveat for caveat in caveats), caveats


async def test_an_abort_lands_both(tmp_path: Path) -> None:
    # For three quarters of a minute it is under way: the command comes before it touches.
    slow = "world.objects.intruder.motion.waypoints.1.speed_m_s=0.05"
    async with hall() as there:
        arming = ("--arm-real", "--arm-actors")
        given = ("--mode", "real", "--json", *there.sets, "--set", slow, *arming)
        async with Program(tmp_path / "out", *given, flown=AVOID) as program:
            await _airborne(program)
            await program.operate("abort")
            landed = await program.end()
        assert (landed.code, run_of(landed)["verdict"]) == (4, "ABORTED"), landed.why
        await asyncio.gather(there.stands("real"), there.stands("intruder"))


async def test_a_silent_actor_proves_nothing_and_is_landed_when_it_is_received_again(
    tmp_path: Path, turn: Callable[[], None]
) -> None:
    async with hall() as there:
        given = ("--mode", "real", "--json", *there.sets, "--arm-real", "--arm-actors")
        async with Program(tmp_path / "out", *given, flown=AVOID) as program:
            await _airborne(program)
            intruder = there.processes["intruder"]
            intruder.send_signal(signal.SIGSTOP)
            down = "real: down: it is disarmed"
            guard = program.run_folder("real") / "guard.jsonl"
            await until(lambda: down in [line.get("text") for line in lines(guard)])
            # For the silent one all have patience for two minutes more, which nothing disturbs.
            turn()
            landed = await program.end()
        run = run_of(landed)
        # Whether poses or all of it is missed first: never a verdict on the real vehicle.
        assert run["verdict"] in {"INVALID", "ERROR"}, landed.why
        assert "intruder" in run["reason"]
        assert landed.code == 3, landed.why
        # Nobody knows whether it is down: that is said, and its guard stays.
        assert "not down" in landed.why
        assert not _is_free(there.ports["intruder"])
        intruder.send_signal(signal.SIGCONT)
        await there.stands("real")
        await there.stands("intruder", restored=False)


async def test_the_guard_lands_both_when_the_program_is_killed(tmp_path: Path) -> None:
    async with hall() as there:
        given = ("--mode", "real", "--json", *there.sets, "--arm-real", "--arm-actors")
        async with Program(tmp_path / "out", *given, flown=AVOID) as program:
            await _airborne(program)
            os.killpg(program.process.pid, signal.SIGKILL)
            await asyncio.gather(
                there.stands("real", restored=False), there.stands("intruder", restored=False)
            )
            events = lines(program.run_folder("real") / "guard.jsonl")
        assert {"orphaned"} <= {event["event"] for event in events}
        assert {"silence"} <= {event.get("kind") for event in events}


async def _airborne(program: Program) -> None:
    """Wait until the intruder has left the ground."""
    await program.stage("goal", "real")

    def flies() -> bool:
        events = lines(program.run_folder("real") / "log.jsonl")
        return any(
            event.get("vehicle") == "intruder"
            and event.get("kind") in {"takeoff", "in_air", "armed"}
            for event in events
        )

    await until(lambda: flies() or program.process.returncode is not None, 60.0)
    assert program.process.returncode is None
