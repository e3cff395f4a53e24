"""`run` says that kernels are compiled, and says nothing where they are cached."""

from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.orchestrator.cli import flight_needs, main
from wil_campaign.orchestrator.cli.flight_needs import NOTICE, compilation_notice
from wil_campaign.orchestrator.run.perception.warm_up import warm_up
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.vehicles.embedded.physics.motion_kernel import estimate_motion
from wil_campaign.worlds.jit import is_kernel_cached
from wil_campaign.worlds.render.shading import write_ids

_ROOT = Path(__file__).parents[3]


@pytest.fixture
def gate() -> Campaign:
    return load_campaign(_ROOT / "campaigns" / "gate.yaml", ExpansionOptions(modes=("wil",)))


@pytest.mark.parametrize("missing", ["estimate_motion", "write_ids"])
def test_each_kernel_that_a_flight_lacks_is_announced(
    gate: Campaign, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    monkeypatch.setattr(flight_needs, "is_kernel_cached", lambda one: one.__name__ != missing)
    assert compilation_notice(gate) == NOTICE


def test_nothing_is_printed_about_kernels_that_are_cached(
    gate: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flight_needs, "is_kernel_cached", lambda _: True)
    assert compilation_notice(gate) is None


def test_nothing_is_printed_about_kernels_after_the_first_flight(
    gate: Campaign, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (plan,) = gate.runs[:1]
    asked: list[Any] = []

    def asked_of(kernel: Any) -> bool:
        asked.append(kernel)
        return True

    monkeypatch.setattr(flight_needs, "is_kernel_cached", asked_of)
    compilation_notice(gate)
    warm_up(RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="virtual")))
    assert asked == [estimate_motion, write_ids]
    assert all(map(is_kernel_cached, asked))


def test_nothing_is_printed_about_kernels_that_no_flight_calls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hover = load_campaign(write_hover(tmp_path))
    monkeypatch.setattr(flight_needs, "is_kernel_cached", lambda one: one.__name__ != "write_ids")
    assert compilation_notice(hover) is None


@pytest.mark.usefixtures("forked_workers")
def test_run_prints_it_before_the_first_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(flight_needs, "is_kernel_cached", lambda _: False)
    out = str(tmp_path / "out")
    assert main(["run", str(write_hover(tmp_path)), "--jobs", "1", "--out", out]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == NOTICE
    assert lines[2].startswith("[1/")
