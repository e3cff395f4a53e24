"""Runs of the shipped campaigns, small enough for tests."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from campaigns.expansion.expansion import Options, load_campaign
from orchestrator.model.operator_command import Inbox
from orchestrator.model.progress import Report
from orchestrator.model.results import RunResult
from orchestrator.run.flight.run import Disturb, fly
from orchestrator.state.run_setup import RunOrder, RunSetup
from safety.guard.core.operator_command import OperatorCommand

ROOT = Path(__file__).parents[2]
SMALL_CAMERAS = tuple(
    f"vehicles.{name}.sensors.camera.{key}={value}"
    for name in ("real", "twin")
    for key, value in (("width_px", 320), ("height_px", 240))
)
"""A quarter of the pixels: the same flight, sooner."""


class NoCommands:
    """An operator who says nothing."""

    def poll(self) -> OperatorCommand | None:
        return None


Flown = tuple[RunResult, Path]
Fly = Callable[..., Flown]


@pytest.fixture
def fly_run(tmp_path: Path) -> Fly:
    """Return a function that flies one run of a shipped campaign in virtual time."""
    flown = 0

    def fly_one(
        campaign: str = "gate",
        case: str = "large",
        mode: str = "wil",
        *,
        sets: tuple[str, ...] = (),
        seed: int | None = None,
        inbox: Inbox | None = None,
        disturb: Disturb | None = None,
        report: Report = lambda _: None,
        has_cameras: bool = True,
    ) -> Flown:
        nonlocal flown
        flown += 1
        sets = (*(SMALL_CAMERAS if has_cameras else ()), *sets)
        options = Options(cases=(case,), modes=(mode,), seed=seed, sets=sets)
        file = ROOT / "campaigns" / f"{campaign}.yaml"
        if "\ncontrols:" in file.read_text("utf-8"):
            # What a test sets may leave a control nothing to fail by; one run is flown here.
            options = replace(options, sets=(*sets, "controls={}"))
        plan = load_campaign(file, options).runs[0]
        folder = tmp_path / f"run{flown}"
        folder.mkdir()
        order = RunOrder(plan=plan, folder=folder, clock="virtual")
        setup = RunSetup.of(order)
        return fly(setup, report, inbox or NoCommands(), disturb=disturb), folder

    return fly_one
