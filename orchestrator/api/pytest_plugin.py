"""The plugin of pytest: each run of a campaign file on its command line is a test.

    pytest campaigns/gate.yaml -k "large and wil"

It does nothing unless a campaign file is named there, and imports what flies only then.
"""

import importlib
import re
from pathlib import Path

import pytest

_CAMPAIGN = re.compile(rb"^[\"']?schema[\"']?\s*:\s*[\"']?wil/campaign/", re.MULTILINE)
_MAX_BYTES = 1_000_000
REPORTS = pytest.StashKey[list[Path]]()
"""The reports that were written in this session."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of campaigns, which are those of `wil-campaign run`."""
    group = parser.getgroup("wil-campaign", "campaigns of wil-campaign")
    group.addoption(
        "--wil-out",
        default="results",
        metavar="DIR",
        help="the folder beneath which the results of campaigns go (default: results)",
    )
    group.addoption(
        "--wil-set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="an override of the campaign files, as --set of `wil-campaign run`",
    )
    group.addoption("--wil-jobs", type=int, default=None, metavar="N", help="runs at once")
    group.addoption("--wil-clock", default=None, choices=["virtual", "wall", "scaled"])
    group.addoption(
        "--wil-arm-real",
        action="store_true",
        help="allow that attached vehicles are armed, which may be hardware",
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Return the collector of a campaign file that the command line names; None for others."""
    if file_path.suffix not in {".yaml", ".yml"} or not parent.session.isinitpath(file_path):
        return None
    with file_path.open("rb") as stream:
        if not _CAMPAIGN.search(stream.read(_MAX_BYTES)):
            return None
    items = importlib.import_module("orchestrator.api.pytest_items")
    collector: pytest.Collector = items.CampaignFile.from_parent(parent, path=file_path)
    return collector


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Print where the reports of the campaigns are."""
    for path in config.stash.get(REPORTS, []):
        terminalreporter.write_line(f"wil-campaign report: {path}")
