"""World-in-the-loop campaigns from Python: load, validate, fly, read and judge results.

    results = wil_campaign.run("campaigns/gate.yaml")
    assert results.accepted

The names in `__all__` are stable: none is removed or changes its meaning without an entry in the
changelog. docs/python.md has examples. An autonomy, which a campaign flies, imports
`wil_campaign.api` instead.
"""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan
    from wil_campaign.foundation.files.documents import BadInput, Problem
    from wil_campaign.orchestrator.campaign.flight_options import FlightOptions
    from wil_campaign.orchestrator.campaign.reevaluation import Judgement
    from wil_campaign.orchestrator.reading.errors import ResultsFolderError
    from wil_campaign.orchestrator.recording.errors import RecordingError
    from wil_campaign.orchestrator.report.ordered_report import Report
    from wil_campaign.orchestrator.run_results.campaign_results import Summary, Totals
    from wil_campaign.orchestrator.run_results.run_result import RunResult
    from wil_campaign.plugins.offline.calls import mix, replay
    from wil_campaign.plugins.offline.errors import OfflineError
    from wil_campaign.plugins.offline.file_mixing import CombinationReport
    from wil_campaign.plugins.offline.replay import ReplayReport
    from wil_campaign.plugins.python.campaign_results import CampaignResults, read_results
    from wil_campaign.plugins.python.flying import CannotFlyError, run, run_async
    from wil_campaign.plugins.python.loading import judge, load, report, validate
    from wil_campaign.plugins.python.mcap_reader import (
        Recorded,
        RecordedEvent,
        RecordedProvenance,
        RecordedReading,
        Recording,
    )
    from wil_campaign.plugins.python.mock_vehicle import (
        MockVehicle,
        MockVehicleError,
        mock_vehicle,
    )
    from wil_campaign.plugins.search.calls import SearchResults, search, search_async
    from wil_campaign.plugins.statistics.campaign_plan import plan
    from wil_campaign.plugins.statistics.comparison.errors import ComparisonError
    from wil_campaign.plugins.statistics.comparison.folder_comparison import (
        FolderComparison,
        compare,
    )
    from wil_campaign.plugins.statistics.history.folder_history import History, history
    from wil_campaign.plugins.statistics.history.records import HistoryFileError
    from wil_campaign.plugins.statistics.study import Study
    from wil_campaign.recipes.working import StepError
    from wil_campaign.safety.model.oracle_results import OracleResult

__all__ = [
    "BadInput",
    "Campaign",
    "CampaignResults",
    "CannotFlyError",
    "CombinationReport",
    "ComparisonError",
    "FlightOptions",
    "FolderComparison",
    "History",
    "HistoryFileError",
    "Judgement",
    "MockVehicle",
    "MockVehicleError",
    "OfflineError",
    "OracleResult",
    "Problem",
    "Recorded",
    "RecordedEvent",
    "RecordedProvenance",
    "RecordedReading",
    "Recording",
    "RecordingError",
    "ReplayReport",
    "Report",
    "ResultsFolderError",
    "RunPlan",
    "RunResult",
    "SearchResults",
    "StepError",
    "Study",
    "Summary",
    "Totals",
    "compare",
    "history",
    "judge",
    "load",
    "mix",
    "mock_vehicle",
    "plan",
    "read_results",
    "replay",
    "report",
    "run",
    "run_async",
    "search",
    "search_async",
    "validate",
]

_MODULES = {
    "campaigns.expansion.expansion": ("Campaign", "RunPlan"),
    "orchestrator.reading.errors": ("ResultsFolderError",),
    "plugins.python.campaign_results": ("CampaignResults", "read_results"),
    "plugins.python.flying": ("CannotFlyError", "run", "run_async"),
    "plugins.python.loading": ("judge", "load", "report", "validate"),
    "orchestrator.campaign.flight_options": ("FlightOptions",),
    "plugins.python.mock_vehicle": ("MockVehicle", "MockVehicleError", "mock_vehicle"),
    "orchestrator.campaign.reevaluation": ("Judgement",),
    "orchestrator.run_results.campaign_results": ("Summary", "Totals"),
    "orchestrator.run_results.run_result": ("RunResult",),
    "orchestrator.recording.errors": ("RecordingError",),
    "plugins.python.mcap_reader": (
        "Recorded",
        "RecordedEvent",
        "RecordedProvenance",
        "RecordedReading",
        "Recording",
    ),
    "orchestrator.report.ordered_report": ("Report",),
    "plugins.offline.calls": ("mix", "replay"),
    "plugins.offline.errors": ("OfflineError",),
    "plugins.offline.file_mixing": ("CombinationReport",),
    "plugins.offline.replay": ("ReplayReport",),
    "plugins.search.calls": ("SearchResults", "search", "search_async"),
    "plugins.statistics.campaign_plan": ("plan",),
    "plugins.statistics.comparison.errors": ("ComparisonError",),
    "plugins.statistics.comparison.folder_comparison": ("FolderComparison", "compare"),
    "plugins.statistics.history.folder_history": ("History", "history"),
    "plugins.statistics.history.records": ("HistoryFileError",),
    "plugins.statistics.study": ("Study",),
    "recipes.working": ("StepError",),
    "safety.model.oracle_results": ("OracleResult",),
    "foundation.files.documents": ("BadInput", "Problem"),
}
"""Where the names above are. A name is imported when it is first used: this module is imported
before every other one of the program, and by every autonomy."""

_CHECKOUT = Path(__file__).parent
if not (_CHECKOUT / "worlds").is_dir():  # unpacked without symbolic links, as by Python's zipfile
    __path__.append(str(_CHECKOUT.parent))


def __getattr__(name: str) -> object:
    """Return a public name, imported at its first use."""
    found = globals()[name] = first_used(name, _MODULES, __name__)
    return found


def first_used(name: str, modules: Mapping[str, tuple[str, ...]], of: str) -> object:
    """Return a name that is imported when it is first used.

    modules: the names by module. of: the module whose attribute it is. Raises AttributeError, and
    ImportError for a name of an absent plugin.
    """
    for module, names in modules.items():
        if name in names:
            return getattr(_imported(module, name), name)
    raise AttributeError(f"module {of!r} has no attribute {name!r}")


def _imported(module: str, name: str) -> ModuleType:
    """Return the module of a public name. Raises ImportError for one of an absent plugin."""
    path = f"{__name__}.{module}"
    try:
        return import_module(path)
    except ModuleNotFoundError as error:
        from wil_campaign.installed_plugins import missing_plugin_text, needed_plugin_text  # noqa: PLC0415 - seldom used

        folder, _, inner = module.partition(".")
        text = needed_plugin_text(f"'{name}'", error)
        if folder == "plugins" and f"{path}.".startswith(f"{error.name}."):
            text = missing_plugin_text(name, inner.partition(".")[0])
        if not text:
            raise
        raise ImportError(text) from error


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted({*globals(), *__all__})
