"""World-in-the-loop campaigns from Python: load, validate, fly, and read results.

    results = wil_campaign.run("campaigns/gate.yaml")
    assert results.accepted

The names in `__all__` are stable: none is removed or changes its meaning without an entry in the
changelog. docs/python.md has examples. An autonomy, which a campaign flies, imports
`wil_campaign.api` instead.
"""

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan
    from wil_campaign.orchestrator.api.campaign_results import CampaignResults, read_results
    from wil_campaign.orchestrator.api.flying import CannotFlyError, run, run_async
    from wil_campaign.orchestrator.api.loading import load, validate
    from wil_campaign.orchestrator.api.mock_vehicle import (
        MockVehicle,
        MockVehicleError,
        mock_vehicle,
    )
    from wil_campaign.orchestrator.campaign.flight_options import FlightOptions
    from wil_campaign.orchestrator.model.campaign_results import Summary, Totals
    from wil_campaign.orchestrator.model.results import RunResult
    from wil_campaign.orchestrator.reading.errors import ResultsFolderError
    from wil_campaign.orchestrator.recording.mcap_reader import (
        Recorded,
        RecordedEvent,
        RecordedProvenance,
        RecordedReading,
        Recording,
    )
    from wil_campaign.plugins.statistics.study import Study
    from wil_campaign.safety.model.oracle_results import OracleResult
    from wil_campaign.worlds.files.documents import BadInput, Problem

__all__ = [
    "BadInput",
    "Campaign",
    "CampaignResults",
    "CannotFlyError",
    "FlightOptions",
    "MockVehicle",
    "MockVehicleError",
    "OracleResult",
    "Problem",
    "Recorded",
    "RecordedEvent",
    "RecordedProvenance",
    "RecordedReading",
    "Recording",
    "ResultsFolderError",
    "RunPlan",
    "RunResult",
    "Study",
    "Summary",
    "Totals",
    "load",
    "mock_vehicle",
    "read_results",
    "run",
    "run_async",
    "validate",
]

_MODULES = {
    "campaigns.expansion.expansion": ("Campaign", "RunPlan"),
    "orchestrator.reading.errors": ("ResultsFolderError",),
    "orchestrator.api.campaign_results": ("CampaignResults", "read_results"),
    "orchestrator.api.flying": ("CannotFlyError", "run", "run_async"),
    "orchestrator.api.loading": ("load", "validate"),
    "orchestrator.campaign.flight_options": ("FlightOptions",),
    "orchestrator.api.mock_vehicle": ("MockVehicle", "MockVehicleError", "mock_vehicle"),
    "orchestrator.model.campaign_results": ("Summary", "Totals"),
    "orchestrator.model.results": ("RunResult",),
    "orchestrator.recording.mcap_reader": (
        "Recorded",
        "RecordedEvent",
        "RecordedProvenance",
        "RecordedReading",
        "Recording",
    ),
    "plugins.statistics.study": ("Study",),
    "safety.model.oracle_results": ("OracleResult",),
    "worlds.files.documents": ("BadInput", "Problem"),
}
"""Where the names above are. A name is imported when it is first used: this module is imported
before every other one of the program, and by every autonomy."""

_CHECKOUT = Path(__file__).parent
if not (_CHECKOUT / "worlds").is_dir():  # unpacked without symbolic links, as by Python's zipfile
    __path__.append(str(_CHECKOUT.parent))


def __getattr__(name: str) -> object:
    """Return a public name, imported at its first use."""
    for module, names in _MODULES.items():
        if name in names:
            found = globals()[name] = getattr(_imported(module, name), name)
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _imported(module: str, name: str) -> ModuleType:
    """Return the module of a public name. Raises ImportError for one of an absent plugin."""
    path = f"{__name__}.{module}"
    try:
        return import_module(path)
    except ModuleNotFoundError as error:
        folder, _, inner = module.partition(".")
        if folder != "plugins" or not f"{path}.".startswith(f"{error.name}."):
            raise
        from wil_campaign.installed_plugins import missing  # noqa: PLC0415 - seldom needed

        raise ImportError(missing(name, inner.partition(".")[0])) from error


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted({*globals(), *__all__})
