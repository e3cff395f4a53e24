"""A campaign flies by the compiled body where there is no JSBSim."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.orchestrator.conftest import ROOT, Fly
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.run.vehicles.vehicle_backends import SubprocessBackend
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.vehicles.embedded.physics import plant

COMPILED = ("vehicles.real.physics=compiled", "vehicles.twin.physics=compiled")


def test_a_pair_without_jsbsim_passes(fly_run: Fly, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plant, "jsbsim", None)
    result, _ = fly_run(sets=COMPILED, has_cameras=True)
    assert result.verdict == "PASS", result.reason
    assert fly_run(sets=COMPILED[:1])[0].verdict == "ERROR"


def test_vehicles_in_processes_of_their_own_get_it(tmp_path: Path) -> None:
    file = ROOT / "campaigns" / "gate.yaml"
    options = ExpansionOptions(cases=("large",), modes=("wil",), sets=COMPILED[1:])
    plan = load_campaign(file, options).runs[0]
    setup = RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="wall"))
    guard: Any = SimpleNamespace(port=lambda _: 14550)
    backend = SubprocessBackend(setup, guard, {})
    sent = {vehicle.name: backend._settings(vehicle).config().physics for vehicle in setup.vehicles}
    assert sent == {"real": "jsbsim", "twin": "compiled"}
