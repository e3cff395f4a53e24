"""What the guard and the drivers of a run are given, by what its campaign says."""

import asyncio
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tests.orchestrator.conftest import ROOT
from tests.orchestrator.sitl_programs import make_arducopter
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.run.vehicles import pair
from wil_campaign.orchestrator.run.vehicles.guard_factory import HANGING_S, guard_of
from wil_campaign.orchestrator.run.vehicles.preflight_checks import _await_positions
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.guard.process.guard_config import GuardConfig
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.links.tapped import TappedLink
from wil_campaign.worlds.frames import AT_ORIGIN


def gate_setup(folder: Path, clock: str, *sets: str) -> RunSetup:
    options = ExpansionOptions(cases=("large",), modes=("wil",), sets=sets)
    plan = load_campaign(ROOT / "campaigns" / "gate.yaml", options).runs[0]
    return RunSetup.of(RunOrder(plan=plan, folder=folder, clock=cast("Any", clock)))


def guard_config(setup: RunSetup, prepared: Any = {}) -> GuardConfig:  # noqa: B006 - read alone
    guard, _, _ = guard_of(setup, record=lambda *_: None, prepared=prepared, tracks={})
    assert isinstance(guard, RemoteGuard)
    return guard._guard_config


async def test_the_guard_is_patient_with_a_silent_orchestrator_by_the_wall_clock(
    tmp_path: Path,
) -> None:
    slow = guard_config(gate_setup(tmp_path, "wall"))
    fast = guard_config(gate_setup(tmp_path, "scaled", "clock.speed=4"))
    assert slow.settings.orchestrator_silent_s == HANGING_S
    assert fast.settings.orchestrator_silent_s == 4 * HANGING_S


async def test_a_launched_vehicle_is_waited_for_at_the_link_of_its_program(tmp_path: Path) -> None:
    launch = f"vehicles.real.link={{launch: ardupilot, binary: {make_arducopter(tmp_path)}}}"
    more = ("vehicles.real.autopilot=ardupilot", "vehicles.real.pose_source=mavlink")
    setup = gate_setup(tmp_path, "wall", launch, *more)
    link = "tcpout://127.0.0.1:5770"
    prepared = {"real": SimpleNamespace(link=link)}
    vehicles = guard_config(setup, prepared).vehicles
    assert (vehicles["real"].link, vehicles["real"].patient) == (link, True)
    assert (vehicles["twin"].link, vehicles["twin"].patient) == ("", False)


async def test_a_run_goes_on_without_its_twin_and_never_without_its_real_vehicle(
    tmp_path: Path,
) -> None:
    setup = gate_setup(tmp_path, "wall")
    assert setup.companion == "twin"
    link = TappedLink(memory_pair()[0])
    contexts = [pair._vehicle_context(setup, one, link) for one in setup.guarded]
    assert [(context.name, context.may_drop_out) for context in contexts] == [
        ("real", False),
        ("twin", True),
    ]


def test_a_vehicle_without_gps_gets_the_origin_of_its_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: dict[str, Any] = {}
    monkeypatch.setattr(pair, "Driver", lambda **given: built.update({given["name"]: given}))
    setup, link = gate_setup(tmp_path, "wall"), TappedLink(memory_pair()[0])
    real, twin = setup.guarded
    for vehicle in (replace(real, has_gps=False), twin):
        pair._vehicle_context(setup, vehicle, link)
    assert built["real"]["earth"] is setup.case.world.frame
    assert built["twin"]["earth"] is None


def test_the_preflight_waits_for_a_vehicle_s_first_pose() -> None:
    async def main() -> None:
        driver = Driver(name="real", link=memory_pair()[0])
        context = VehicleContext("real", driver, AT_ORIGIN, "mocap")
        loop = asyncio.get_running_loop()
        loop.call_later(0.5, lambda: context.poses.add(loop.time(), AT_ORIGIN))
        began_s = loop.time()
        await _await_positions([context])
        assert 0.5 <= loop.time() - began_s < 1.0

    run_virtual(main())
