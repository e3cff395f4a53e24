"""Whole flights, guard and vehicles processes of their own: by the wall clock, and in lockstep."""

import asyncio
import json
import signal
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.orchestrator.wall_runs import SHORT, STAYING, Program, lines, stages
from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.vehicles.autopilots.autopilot import FlightMode, MavlinkTarget
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.links.udp import UdpLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

LOCKSTEP = ("--set", "clock.speed=1")
"""With `--clock scaled`: in real time where the machine allows it; time waits for who is late."""


def kinds(log: Path) -> set[tuple[str, int]]:
    """Return which messages of whom a .tlog holds."""
    link: Any = mavutil.mavlink_connection(str(log))
    found = set()
    while (message := link.recv_match()) is not None:
        found.add((message.get_type(), message.get_srcSystem()))
    link.close()
    return found


async def test_the_pair_flies_through_the_guards_process(tmp_path: Path) -> None:
    async with Program(tmp_path / "out", "--mode", "wil", "--json", *SHORT) as program:
        landed = await program.end()
        assert list((program.runtime / "wil-campaign").iterdir()) == []
    assert (landed.code, landed.err) == (0, ""), landed.why
    summary = json.loads(landed.out)
    assert [(run["verdict"], run["reason"]) for run in summary["runs"]] == [("PASS", "")]
    assert summary["clock"] == "wall"
    folder = program.run_folder()
    assert stages(folder)[-2:] == ["landed", "end"]
    journal = lines(folder / "guard.jsonl")
    assert journal[-1]["event"] == "end"
    assert [line["vehicle"] for line in journal if line["event"] == "started"] == ["real", "twin"]
    pids = [line["pid"] for line in journal if line["event"] in {"opened", "started"}]
    assert [ProcessId.of(pid) for pid in pids] == [None] * 3
    for name, system in (("real", 1), ("twin", 2)):
        assert {("HEARTBEAT", system), ("COMMAND_LONG", 245)} <= kinds(folder / f"{name}.tlog")


@pytest.mark.no_turn("lockstep")
async def test_the_operator_holds_and_gives_another_fence_and_then_aborts(tmp_path: Path) -> None:
    path = tmp_path / "fence.yaml"
    path.write_text("box: {north_m: [-0.9, 6], east_m: [-4, 4], up_m: [-0.6, 3]}")
    given = ("--json", "--mode", "sim", *LOCKSTEP, *STAYING)
    async with Program(tmp_path / "out", *given, clock="scaled") as program:
        await program.stage("goal", mode="sim")
        held = await program.operate("hold", "--who", "anna")
        assert held.code == 0
        assert held.out.splitlines() == [
            "gate: held: 1 run in flight; no run is started",
            "gate: acknowledged by large/sim/1",
        ]
        for _ in range(3):
            changed = await program.operate("fence", str(path), "--who", "anna")
            # A computer that is busy may not have placed it within the last second.
            if "was not seen" not in changed.err:
                break
        assert (changed.code, changed.err) == (0, ""), changed.why
        assert changed.out == "large/sim/1: cli:anna changed the fence of twin\n"
        aborted = await program.operate("abort", str(program.folder), "--who", "anna")
        assert aborted.code == 0, aborted.why
        # The run's guard and the campaign answer on sockets of their own, in either order.
        assert sorted(aborted.out.splitlines()) == [
            "gate: acknowledged by large/sim/1",
            "gate: all vehicles land, and no further run is flown",
            "large/sim/1: all vehicles are being landed",
        ]
        landed = await program.end()
        assert list((program.runtime / "wil-campaign").iterdir()) == []
    assert landed.code == 4, landed.why
    (run,) = json.loads(landed.out)["runs"]
    assert run["verdict"] == "INVALID"
    assert run["reason"].startswith("held by cli:anna after the goal was given")
    assert [(other["verdict"], other["reason"]) for other in run["also"]][:1] == [
        ("ABORTED", "aborted by cli:anna")
    ]
    folder = program.run_folder("sim")
    assert "landed" in stages(folder)
    told = [line.get("kind") for line in lines(folder / "guard.jsonl")]
    assert told.index("hold") < told.index("proposed") < told.index("geofence")
    aboard = [line for line in lines(folder / "log.jsonl") if line["event"] == "fence"]
    assert [line["ceiling_m"] for line in aboard] == [3.3, 4.0]
    (changed_fence,) = json.loads((folder / "result.json").read_text())["fence_changes"]
    assert (changed_fence["by"], changed_fence["vehicles"]) == ("cli:anna", ["twin"])
    asked = [(a["who"], a["command"], a["ok"]) for a in lines(program.folder / "operator.jsonl")]
    assert ("cli:anna", "geofence", True) in asked
    assert [who_and_what[:2] for who_and_what in (asked[0], asked[-1])] == [
        ("cli:anna", "hold"),
        ("cli:anna", "abort"),
    ]


@pytest.mark.no_turn("lockstep")
async def test_ctrl_c_lands_first(tmp_path: Path) -> None:
    given = ("--mode", "wil", "--json", *LOCKSTEP, *STAYING)
    async with Program(tmp_path / "out", *given, clock="scaled") as program:
        await program.stage("takeoff")
        program.process.send_signal(signal.SIGINT)
        landed = await program.end()
    assert landed.code == 130, landed.why
    (run,) = json.loads(landed.out)["runs"]
    assert (run["verdict"], run["reason"]) == ("ABORTED", "aborted by Ctrl-C")
    assert "landed" in stages(program.run_folder())


class GroundStation:
    """QGroundControl as far as the guard can tell: hears on one port, answers all who speak."""

    def __init__(self) -> None:
        self._codec = MavlinkCodec(system_id=255, component_id=190)
        self.link = UdpLink(address=LinkAddress(kind="udpin", host="127.0.0.1", port=0))
        self.link.receive(self._hear)
        self.heard: dict[int, set[str]] = {}
        self.armed = False

    def _hear(self, data: bytes, _: float) -> None:
        for message in self._codec.parse(data):
            self.heard.setdefault(message.get_srcSystem(), set()).add(message.get_type())
            if message.get_type() == "HEARTBEAT" and message.get_srcSystem() == 1:
                self.armed = bool(message.base_mode & 128)

    def ask(self, mode: FlightMode) -> None:
        self.link.write(self._codec.pack(Px4().set_mode(MavlinkTarget(1), mode)))

    def set_parameter(self, name: str) -> None:
        message = mavlink.MAVLink_param_set_message(1, 1, name.encode(), 0.0, 6)
        self.link.write(self._codec.pack(message))


async def test_a_pilot_at_a_ground_station_takes_over(tmp_path: Path) -> None:
    context = GroundStation()
    async with context.link:
        where = f"real=udpout://127.0.0.1:{context.link.local_port}"
        given = ("--mode", "wil", "--json", "--gcs", where, *STAYING)
        async with Program(tmp_path / "out", *given) as program:
            await program.stage("goal")
            assert context.heard.keys() == {1}
            assert {"HEARTBEAT", "LOCAL_POSITION_NED"} <= context.heard[1]
            context.set_parameter("GF_ACTION")
            await program.await_event("dropped")
            context.ask(FlightMode.HOLD)
            await program.await_event("takeover")
            await asyncio.sleep(2.0)
            assert context.armed
            context.ask(FlightMode.LAND)
            landed = await program.end()
    assert landed.code == 4, landed.why
    (run,) = json.loads(landed.out)["runs"]
    assert run["verdict"] == "ABORTED"
    assert run["reason"] == ("the ground station 255/190 took real over by MAV_CMD_DO_SET_MODE")
    assert "landed" in stages(program.run_folder())
    taken = [line for line in lines(program.run_folder() / "guard.jsonl") if "kind" in line]
    assert next(one["text"] for one in taken if one["kind"] == "dropped") == (
        "PARAM_SET of GF_ACTION from the ground station 255/190 was not forwarded"
    )
    phases = [one["text"] for one in taken if one["vehicle"] == "real" and one["kind"] == "action"]
    assert phases[-1] == "real: down: it is disarmed"
    assert "real: under the pilot's control: the pilot has control" in phases


SLOW = """
import time

from wil_campaign.api import Command, VelocitySetpoint


class Slow:
    def __init__(self, *, goal, parameters, seed):
        pass

    def perceive(self, reading):
        pass

    def act(self, telemetry):
        time.sleep(0.2)
        return Command(VelocitySetpoint((0.05, 0.0, 0.0)))
"""


async def test_a_slow_autonomy_fails_and_holds_nothing_up(tmp_path: Path) -> None:
    path = tmp_path / "slow.py"
    path.write_text(SLOW)
    given = ("--mode", "sim", "--json", *SHORT, "--set", f"autonomy={{use: {path}:Slow}}")
    async with Program(tmp_path / "out", *given) as program:
        landed = await program.end()
    assert landed.code == 1, landed.why
    (run,) = json.loads(landed.out)["runs"]
    assert run["verdict"] == "FAIL"
    assert run["reason"].startswith("the autonomy of twin is too slow for the wall clock: it is 0.")
    assert "slow.py:15, `time.sleep(0.2)`" in run["reason"]
    assert run["decided_by"] == "autonomy/twin"
    assert "landed" in stages(program.run_folder("sim"))
    guarded = [line.get("kind") for line in lines(program.run_folder("sim") / "guard.jsonl")]
    assert "silence" not in guarded
