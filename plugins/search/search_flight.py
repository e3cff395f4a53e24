"""Flies the search of a campaign file from its beginning to its report."""

from collections.abc import Callable
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import Options
from wil_campaign.orchestrator.campaign.display_thread import Display
from wil_campaign.orchestrator.campaign.flight_options import FlightOptions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import require_writable
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from wil_campaign.orchestrator.campaign.workers.run_server import start_run_server
from wil_campaign.orchestrator.cli.arming_consent import RefusedError, clear
from wil_campaign.orchestrator.cli.engine_flight import on_engine
from wil_campaign.plugins.search.engine import BatchEngine
from wil_campaign.plugins.search.exploration.search import most_flights
from wil_campaign.plugins.search.exploration.search_campaign import SearchCampaign
from wil_campaign.plugins.search.exploration.search_file import load_search
from wil_campaign.plugins.search.report import search_report
from wil_campaign.plugins.search.search_runner import SearchOutcome, fly_search


def fly_file(
    file: Path, selection: Options, options: FlightOptions, display_of: Callable[[int], Display]
) -> tuple[SearchCampaign, SearchOutcome]:
    """Fly the search of a campaign file. display_of: shows it, given its largest number of flights.

    Raises BadInput, OutputError, OperatingError, RefusedError, EngineError, ResumeError,
    SearchError, MissingExtraError.
    """
    found = load_search(file, selection)
    _refuse_attached(found)
    require_writable(options.out, junit=None)
    start_run_server()
    here = clear(found.flown, options)
    most = most_flights(found.problem(at_once=here.jobs))
    with on_engine(found.flown, options, here, runs=most, again=True) as cleared:
        most = most_flights(found.problem(at_once=cleared.jobs))
        with display_of(most) as display:
            strategy = found.part.strategy
            display.say(
                f"{found.campaign.name}: search by {strategy}, at most {most} flights, "
                f"{cleared.jobs} at a time, {cleared.clock} clock"
            )
            engine = BatchEngine(cleared=cleared, watcher=display)
            return found, fly_search(found, options, cleared, engine, display.say)


def write_report(
    search: SearchCampaign, outcome: SearchOutcome, err: Callable[[str], object]
) -> Path | None:
    """Write the report of a search; return its path, or None after an error message to `err`."""
    try:
        return search_report.write_search_page(search, outcome)
    except Exception as error:  # noqa: BLE001 - the flights are over, and their results are whole
        why = f"{type(error).__name__}: {error}"
        name = search_report.FILE_NAME
        err(f"ERROR: {name} was not written ({why}); the results are complete without it")
        return None


def _refuse_attached(found: SearchCampaign) -> None:
    """Raise RefusedError where the budget has a mode in which an attached vehicle flies."""
    attached = attached_vehicles(found.flown)
    if not attached:
        return
    names = " and ".join(one.name for one in attached)
    where = "".join(f" of bench {bench.name}" for bench in found.campaign.benches)
    raise RefusedError(
        f"{names}{where}: a search flies no attached vehicle, because no person brings it back to "
        "its start between proposals; give a budget to mode sim alone, and fly the files of "
        "failures by `run`",
        2,
    )
