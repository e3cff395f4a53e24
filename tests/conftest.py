"""For all tests: properties are searched without a deadline, for these machines are shared."""

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")


pytest_plugins = ["pytester"]

ROOT = Path(__file__).parent
FAST = (
    "orchestrator/cli/test_arming_consent.py",
    "orchestrator/cli/test_external_lines.py",
    "orchestrator/delivery",
    "orchestrator/model",
    "orchestrator/report/test_report_page.py",
    "orchestrator/report/test_report_reading.py",
    "orchestrator/state",
    "recipes",
    "safety/evaluation",
    "safety/evidence",
    "safety/fence",
    "safety/guard/core",
    "safety/model",
    "safety/oracles",
    "safety/stl/test_stl_formula.py",
    "test_dependencies.py",
    "test_docs.py",
    "vehicles/autopilots",
    "vehicles/clocks",
    "vehicles/driver/session",
    "vehicles/mavlink",
    "vehicles/perception",
    "vehicles/poses",
    "vehicles/readings",
    "vehicles/sensors",
    "vehicles/test_telemetry_fit.py",
    "worlds/files",
    "worlds/rays",
    "worlds/render",
    "worlds/scene",
    "worlds/test_frames.py",
    "worlds/test_geodesy.py",
    "worlds/world_file",
)
"""What flies no run, starts no process and searches not for long; everything else is slow."""

WALL = (
    "orchestrator/campaign/test_attached_run.py",
    "orchestrator/campaign/test_resumption.py",
    "orchestrator/cli/commands/test_run_command.py",
    "orchestrator/cli/test_arming_consent.py",
    "orchestrator/console/test_console_flight.py",
    "orchestrator/external/test_external_flights.py",
    "orchestrator/operator",
    "orchestrator/recording/test_wall_recording.py",
    "orchestrator/run/flight/test_mavsdk_run.py",
    "orchestrator/run/flight/test_scaled_run.py",
    "orchestrator/run/flight/test_wall_run.py",
    "safety/guard/process",
    "vehicles/clients",
    "vehicles/driver/test_conformance.py",
    "vehicles/embedded/process",
    "vehicles/links/test_flapping.py",
    "vehicles/mavsdk",
    "vehicles/sources/test_streams.py",
)
"""What waits on the wall clock: it leaves the processor idle most of the time."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is not of the fast tier, and let workers fly the wall clock's tests first.

    `pytest -m "not slow"` leaves out what is not of the fast tier. Workers of pytest-xdist each
    begin with their share of the tests that wait on the wall clock: beside each other these have
    the processor that they need, beside searches and flights in virtual time they have not.
    """
    waiting: list[pytest.Item] = []
    others: list[pytest.Item] = []
    for item in items:
        path = item.path.relative_to(ROOT)
        if not _is_among(path, FAST):
            item.add_marker(pytest.mark.slow)
        (waiting if _is_among(path, WALL) else others).append(item)
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if workers > 1:
        items[:] = _shares(waiting, others, workers)


def _is_among(path: Path, places: Sequence[str]) -> bool:
    return any(path.is_relative_to(place) for place in places)


def _shares(
    first: list[pytest.Item], then: list[pytest.Item], workers: int
) -> Iterator[pytest.Item]:
    """Yield equal shares of tests, one behind the other: `--dist worksteal` hands them out so."""
    total = len(first) + len(then)
    for k in range(workers):
        mine = first[k::workers]
        yield from mine
        size = total * (k + 1) // workers - total * k // workers - len(mine)
        yield from then[:size]
        then = then[size:]


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """A folder for sockets: beneath pytest's own their paths are too long."""
    folder = Path(tempfile.mkdtemp(prefix="wil-"))
    yield folder
    shutil.rmtree(folder)
