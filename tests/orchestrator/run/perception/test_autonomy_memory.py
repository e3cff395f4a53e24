"""An autonomy that takes too much memory or time ends its run in words, and the flight lands."""

import importlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wil_campaign.campaigns.values.autonomy_limits import AutonomyLimits
from wil_campaign.foundation.processes.process_memory import limited_allocation
from wil_campaign.orchestrator.run.perception.autonomy_calls import AutonomyFault, call_autonomy
from wil_campaign.orchestrator.run.perception.autonomy_memory import MemoryMeter
from wil_campaign.orchestrator.run.perception.runner_factory import _build_autonomy
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.setpoints import VelocitySetpoint

Fly = Callable[..., tuple[RunResult, Path]]
_MB = 1_000_000


@pytest.mark.parametrize(("grown_mb", "exceeds"), [(0.0, False), (500.0, False), (501.0, True)])
def test_growth_counts_from_where_the_meter_began(grown_mb: float, exceeds: bool) -> None:
    held = iter((2000.0, 2000.0 + grown_mb))
    meter = MemoryMeter(AutonomyLimits(memory_mb=500.0), resident_mb=lambda: next(held))
    text = meter.excess()
    assert bool(text) is exceeds
    if exceeds:
        assert "grown by 501 MB, and autonomy.limits.memory_mb is 500; find what it keeps" in text


def test_memory_that_is_refused_is_no_statement_about_the_autonomy() -> None:
    with pytest.raises(AutonomyFault) as caught, limited_allocation(100.0):
        call_autonomy(lambda: np.ones(100 * _MB))
    assert caught.value.kind == "ERROR"
    text = str(caught.value)
    assert text.startswith("was refused memory: ")
    assert "test_autonomy_memory.py:" in text
    assert text.endswith("ask for less, or raise autonomy.limits.memory_mb")
    assert np.ones(20 * _MB).nbytes == 160 * _MB, "afterwards there is no limit any more"


class Hoarder:
    """An autonomy that keeps 40 MB of each call; the vehicle stands in the air."""

    def __init__(self, *, parameters: Mapping[str, object], **_: object) -> None:
        self._kept: list[object] = []
        self._megabytes = int(str(parameters.get("megabytes", 40)))

    def perceive(self, reading: object) -> None:
        pass

    def act(self, telemetry: object) -> Command:
        self._kept.append(np.ones(self._megabytes * _MB, np.uint8))
        return Command(VelocitySetpoint((0.0, 0.0, 0.0)))


def test_an_autonomy_that_cannot_be_built_is_an_error_of_the_run() -> None:
    """It passed `validate` elsewhere: a module is missing on this machine, say."""
    limits = AutonomyLimits()
    under_test = SimpleNamespace(
        limits=limits, build=lambda _: importlib.import_module("no_such_module")
    )
    setup: Any = SimpleNamespace(seed=1, case=SimpleNamespace(under_test=under_test))
    with pytest.raises(AutonomyFault, match=r"the autonomy of twin crashed: .*no_such") as caught:
        _build_autonomy(setup, "twin", MemoryMeter(limits, resident_mb=lambda: 1.0))
    assert caught.value.kind == "ERROR"


def test_an_autonomy_too_large_once_it_is_built_is_an_error_before_it_flies() -> None:
    limits = AutonomyLimits(memory_mb=300.0)
    held = iter((1000.0, 1400.0))
    meter = MemoryMeter(limits, resident_mb=lambda: next(held))
    under_test = SimpleNamespace(limits=limits, build=lambda _: Hoarder(parameters={}))
    setup: Any = SimpleNamespace(seed=1, case=SimpleNamespace(under_test=under_test))
    with pytest.raises(AutonomyFault, match="the autonomy of twin uses too much") as caught:
        _build_autonomy(setup, "twin", meter)
    assert caught.value.kind == "ERROR"


@pytest.mark.parametrize(
    ("megabytes", "said"),
    [
        (40, "the autonomy of twin uses too much memory: the run's process has grown by "),
        (4000, "the autonomy of twin was refused memory: "),
    ],
)
def test_a_run_whose_autonomy_eats_memory_fails_and_lands(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, megabytes: int, said: str
) -> None:
    monkeypatch.setattr(
        "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy", lambda *_: Hoarder
    )
    limited = (
        f"autonomy={{use: place, with: {{megabytes: {megabytes}}}, limits: {{memory_mb: 300}}}}"
    )
    result, folder = fly_run(
        mode="sim", sets=(limited, "oracles={landed: {}, reached: {}}"), has_cameras=False
    )
    assert (result.verdict, result.reason[: len(said)]) == ("FAIL", said)
    assert "autonomy.limits.memory_mb" in result.reason
    (landed,) = [
        oracle for oracle in result.oracles if (oracle.name, oracle.vehicle) == ("landed", "twin")
    ]
    assert landed.verdict == "PASS"
    stages = [
        line["stage"]
        for line in map(json.loads, (folder / "log.jsonl").read_text("utf-8").splitlines())
        if line["event"] == "stage"
    ]
    assert stages[-2:] == ["landed", "end"]


class Spinner(Hoarder):
    """An autonomy whose first answer never comes."""

    def act(self, telemetry: object) -> Command:
        while True:
            pass


def test_a_run_whose_autonomy_spins_ends_within_the_campaigns_time_for_a_call(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy", lambda *_: Spinner
    )
    limited = "autonomy={use: place, limits: {call_s: 0.3}}"
    result, _ = fly_run(
        mode="sim", sets=(limited, "oracles={landed: {}, reached: {}}"), has_cameras=False
    )
    assert result.verdict == "FAIL"
    # On a busy machine it may be an earlier call, of `perceive`, that takes as long.
    said = "the autonomy of twin gave no answer within 0.3 s, its limit (autonomy.limits.call_s)"
    assert result.reason.startswith(said)
