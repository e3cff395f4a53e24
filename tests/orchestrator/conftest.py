"""Runs of the shipped campaigns, small enough for tests; workers that need not import anew."""

import multiprocessing
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from tests.made_once import made_once
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.workers.run_server import start_run_server
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.operator import operator_log
from wil_campaign.orchestrator.operator.run_messages import OperatorInbox, Report
from wil_campaign.orchestrator.run.flight.run import Disturb, fly_one_run
from wil_campaign.orchestrator.run.vehicles import vehicle_backends
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state import run_log
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def patient_logs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have each line in its file before a test goes on, however busy the machine is."""
    monkeypatch.setattr(run_log, "_WRITTEN_WITHIN_S", 60.0)
    monkeypatch.setattr(operator_log, "_WRITTEN_WITHIN_S", 60.0)


SMALL_CAMERAS = tuple(
    f"vehicles.{name}.sensors.camera.{key}={value}"
    for name in ("real", "twin")
    for key, value in (("width_px", 320), ("height_px", 240))
)
"""A quarter of the pixels: the same flight, sooner."""
STEP = (
    "autonomy={use: autonomies/straight.py:StraightAutonomy, with: {speed_m_s: 0.8, for_s: 1}}",
    "goal.altitude_m=0.5",
    "oracles.reached.required=false",
)
"""Up, a step ahead, and down, for what is no matter of the mission."""
FEW_PICTURES = (
    *(
        f"vehicles.{name}.sensors.camera.{key}={value}"
        for name in ("real", "twin")
        for key, value in (("width_px", 160), ("height_px", 120), ("rate_hz", 5))
    ),
    "recipe.sensors.camera.rate_hz=5",
)
"""Few and small pictures, where nothing but the autonomy looks at them: half of the costs."""
BRIEF = (*STEP, *FEW_PICTURES)
"""Both: a quarter of the gate's costs."""


class NoCommands:
    """An operator who says nothing."""

    def poll(self) -> OperatorCommand | None:
        return None


Flown = tuple[RunResult, Path]
Fly = Callable[..., Flown]


@pytest.fixture(scope="session")
def fork_server() -> None:
    """Start the server of runs before any test changes the environment."""
    start_run_server()


@contextmanager
def workers_forked() -> Iterator[None]:
    """Have what is otherwise spawned forked from the server of runs: 2 s of CPU less each.

    It checks autonomies and draws reports; it has the environment of the first test.
    """
    context_of = multiprocessing.get_context

    def forked(method: str | None = None) -> object:
        return context_of("forkserver" if method == "spawn" else method)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(multiprocessing, "get_context", forked)
        yield


@pytest.fixture
def forked_workers(fork_server: None) -> Iterator[None]:
    """Have all workers forked during the test."""
    with workers_forked():
        yield


@contextmanager
def vehicles_on() -> Iterator[None]:
    """Have embedded vehicles in this process on for a minute already, as those on the wall clock.

    Their boot is no matter of most flights: 6 s of each with PX4, 40 s with ArduCopter. Nor are the
    2 s for which a PX4 stands armed after its landing, an eighth of a brief flight.
    """
    config: Callable[..., object] = vars(vehicle_backends)["EmbeddedConfig"]

    def on(*, autopilot: str, parameters: Mapping[str, float], **given: object) -> object:
        short = {"COM_DISARM_LAND": 0.2} if autopilot == "px4" else {}
        return config(
            autopilot=autopilot, parameters={**short, **parameters}, running_s=60.0, **given
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vehicle_backends, "EmbeddedConfig", on)
        yield


GATE_FLOWN = (
    *("--case", "large", "--case", "blind", "--mode", "sim"),
    *(option for value in SMALL_CAMERAS for option in ("--set", value)),
)
"""The selection and overrides of the flown gate: case large in mode sim, and its blind control."""


@pytest.fixture(scope="session")
def flown_gate(fork_server: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the results folder of a run and a control of gate.yaml, flown as users fly them."""
    gate = str(ROOT / "campaigns" / "gate.yaml")

    def fly(out: Path) -> None:
        with workers_forked():
            given = (*GATE_FLOWN, "--repetitions", "1", "--out", str(out), "--jobs", "1", "--json")
            assert main(["run", gate, *given]) == 0

    (folder,) = (made_once(tmp_path_factory, "flown-gate", fly) / "gate").iterdir()
    return folder


@pytest.fixture
def fly_run(tmp_path: Path) -> Fly:
    """Return a function that flies one run of a shipped campaign in virtual time.

    cameras: their overrides; SMALL_CAMERAS where pictures are what is tested. boots: vehicles are
    switched on with the run, as in campaigns; else they are on already.
    """
    flown = 0

    def fly_one(
        campaign: str = "gate",
        case: str = "large",
        mode: str = "wil",
        *,
        sets: tuple[str, ...] = (),
        seed: int | None = None,
        inbox: OperatorInbox | None = None,
        disturb: Disturb | None = None,
        report: Report = lambda _: None,
        has_cameras: bool = True,
        cameras: tuple[str, ...] = FEW_PICTURES,
        boots: bool = False,
    ) -> Flown:
        nonlocal flown
        flown += 1
        sets = (*(cameras if has_cameras else ()), *sets)
        options = ExpansionOptions(cases=(case,), modes=(mode,), seed=seed, sets=sets)
        file = ROOT / "campaigns" / f"{campaign}.yaml"
        if "\ncontrols:" in file.read_text("utf-8"):
            # What a test sets may leave a control nothing to fail by; one run is flown here.
            options = replace(options, sets=(*sets, "controls={}"))
        plan = load_campaign(file, options).runs[0]
        folder = tmp_path / f"run{flown}"
        folder.mkdir()
        order = RunOrder(plan=plan, folder=folder, clock="virtual")
        setup = RunSetup.of(order)
        with nullcontext() if boots else vehicles_on():
            return fly_one_run(setup, report, inbox or NoCommands(), disturb=disturb), folder

    return fly_one
