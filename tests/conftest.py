"""For all tests: properties are searched without a deadline, for these machines are shared."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")


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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what is not of the fast tier: `pytest -m "not slow"` leaves it out."""
    for item in items:
        path = item.path.relative_to(ROOT)
        if not any(path.is_relative_to(fast) for fast in FAST):
            item.add_marker(pytest.mark.slow)


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """A folder for sockets: beneath pytest's own their paths are too long."""
    folder = Path(tempfile.mkdtemp(prefix="wil-"))
    yield folder
    shutil.rmtree(folder)
