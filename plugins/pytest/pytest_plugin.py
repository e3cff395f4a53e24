"""The pytest plugin: runs of a campaign file are tests, and tests have mock vehicles.

    pytest campaigns/gate.yaml -k "large and wil"

It does nothing unless a campaign file is named on the command line or a test requests
`mock_vehicle`; only then it imports the code that flies.
"""

import importlib
import re
from collections.abc import Callable, Generator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from wil_campaign.plugins.python.mock_vehicle import MockVehicle

_CAMPAIGN = re.compile(rb"^[\"']?schema[\"']?\s*:\s*[\"']?wil/campaign/", re.MULTILINE)
_MAX_BYTES = 1_000_000
REPORTS = pytest.StashKey[list[Path]]()
"""The reports that were written in this session."""
_MOCKS = pytest.StashKey[list["MockVehicle"]]()
"""The mock vehicles of a test."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of campaigns, which are those of `wil-campaign run`."""
    group = parser.getgroup("wil-campaign", "campaigns of wil-campaign")
    group.addoption(
        "--wil-out",
        default="results",
        metavar="DIR",
        help="the folder for the results of campaigns (default: results)",
    )
    group.addoption(
        "--wil-set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="an override of the campaign files, as --set of `wil-campaign run`",
    )
    group.addoption(
        "--wil-engine",
        default="local",
        metavar="ENGINE",
        help="where runs fly: local, ray or ray://HOST:PORT (default: local)",
    )
    group.addoption(
        "--wil-store",
        default="",
        metavar="URL",
        help="store for the results of a cluster: file:///FOLDER that its nodes share, or s3://BUCKET/PREFIX",
    )
    group.addoption(
        "--wil-bench-file",
        action="append",
        default=[],
        metavar="FILE",
        help="a bench of this machine, for campaigns that request one",
    )
    group.addoption("--wil-jobs", type=int, default=None, metavar="N", help="runs at once")
    group.addoption("--wil-clock", default=None, choices=["virtual", "wall", "scaled"])
    group.addoption(
        "--wil-arm-real",
        action="store_true",
        help="allow arming of attached vehicles, which may be hardware",
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Return the collector of a campaign file that the command line names; None for others."""
    if file_path.suffix not in {".yaml", ".yml"} or not parent.session.isinitpath(file_path):
        return None
    with file_path.open("rb") as stream:
        if not _CAMPAIGN.search(stream.read(_MAX_BYTES)):
            return None
    items = importlib.import_module("wil_campaign.plugins.pytest.pytest_items")
    collector: pytest.Collector = items.CampaignFile.from_parent(parent, path=file_path)
    return collector


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Print the caveats of passed runs, and where the reports of the campaigns are."""
    passed = terminalreporter.getreports("passed")
    given = (pair for report in passed for pair in report.user_properties)
    for text in dict.fromkeys(str(value) for name, value in given if name == "caveat"):
        terminalreporter.write_line(f"wil-campaign caveat: {text}")
    for path in config.stash.get(REPORTS, []):
        terminalreporter.write_line(f"wil-campaign report: {path}")


@pytest.fixture
def mock_vehicle(request: pytest.FixtureRequest) -> Generator[Callable[..., "MockVehicle"]]:
    """Start embedded vehicles, each a process on a real MAVLink link, until the test ends.

    `mock_vehicle("px4", profile=..., world=..., speed=..., faults=...)` returns once it is ready;
    programs connect to its `url` (MAVSDK) or `device` (pymavlink, MAVProxy). The arguments are
    those of `wil_campaign.mock_vehicle`. Its output is shown if the test fails.
    """
    mock = importlib.import_module("wil_campaign.plugins.python.mock_vehicle")
    started: list[MockVehicle] = request.node.stash.setdefault(_MOCKS, [])
    with ExitStack() as stack:

        def start(autopilot: Any, **options: Any) -> "MockVehicle":
            try:
                vehicle: MockVehicle = mock.mock_vehicle(autopilot, **options)
                started.append(vehicle)
                return stack.enter_context(vehicle)
            except mock.MOCK_ERRORS as error:
                pytest.fail(f"mock_vehicle({autopilot!r}): {error}", pytrace=False)

        try:
            yield start
        finally:
            try:
                stack.close()
            except mock.MockVehicleError as error:
                pytest.fail(str(error), pytrace=False)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add the output of its mock vehicles to the report of a failed test."""
    report = yield
    if report.failed:
        for vehicle in item.stash.get(_MOCKS, []):
            name = f"mock {vehicle.autopilot} at {vehicle.url}"
            report.sections.append((name, vehicle.output))
    return report
