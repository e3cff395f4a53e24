"""Flies the search of a campaign file from its beginning to its report."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import ExpansionOptions
from wil_campaign.orchestrator.campaign.display_thread import ProgressDisplay
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.folder.bench_lock import held_benches, held_links
from wil_campaign.orchestrator.campaign.folder.campaign_folder import require_writable_results
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from wil_campaign.orchestrator.campaign.workers.run_engine import LOCAL
from wil_campaign.orchestrator.campaign.workers.run_server import start_run_server
from wil_campaign.orchestrator.cli.arming_consent import (
    REFUSED,
    FlightRefusedError,
    clear_for_flight,
    has_terminal,
    require_may_arm,
    user_name,
)
from wil_campaign.orchestrator.cli.engine_flight import cleared_on_engine
from wil_campaign.plugins.search.engine import BatchEngine
from wil_campaign.plugins.search.exploration.search import most_flights
from wil_campaign.plugins.search.exploration.search_campaign import SearchCampaign
from wil_campaign.plugins.search.exploration.search_file import load_search
from wil_campaign.plugins.search.report import search_report
from wil_campaign.plugins.search.search_runner import SearchOutcome, fly_search


def fly_search_file(
    file: Path,
    selection: ExpansionOptions,
    options: FlightOptions,
    display_of: Callable[[int], ProgressDisplay],
) -> tuple[SearchCampaign, SearchOutcome]:
    """Fly the search of a campaign file. display_of: shows it, given its largest number of flights.

    Raises BadInput, OutputError, OperatingError, RefusedError, EngineError, ResumeError,
    SearchError, MissingExtraError, TakenError.
    """
    start_run_server()  # it imports while the search is read
    found = load_search(file, selection)
    attached = attached_vehicles(found.flown)
    links = [link for flown in attached for link in flown.addresses]
    if attached:
        _require_person(found, options)
    require_writable_results(options.out, junit=None)
    with held_benches(found.campaign.benches if attached else ()), held_links(links):
        # Where a vehicle is attached, the person is asked before each batch.
        here = clear_for_flight(found.flown, replace(options, arm=not attached))
        if here.settings:
            found = load_search(file, replace(selection, sets=(*selection.sets, *here.settings)))
        return _fly_cleared(found, options, here, display_of, asks=options if attached else None)


def _fly_cleared(
    found: SearchCampaign,
    options: FlightOptions,
    here: ClearedCampaign,
    display_of: Callable[[int], ProgressDisplay],
    *,
    asks: FlightOptions | None,
) -> tuple[SearchCampaign, SearchOutcome]:
    """Fly a search that is cleared on this machine, on its engine. asks: see BatchEngine."""
    most = most_flights(found.problem(at_once=here.jobs))
    with cleared_on_engine(found.flown, options, here, runs=most, again=True) as cleared:
        most = most_flights(found.problem(at_once=cleared.jobs))
        with display_of(most) as display:
            strategy = found.part.strategy
            display.say(
                f"{found.campaign.name}: search by {strategy}, at most {most} flights, "
                f"{cleared.jobs} at a time, {cleared.clock} clock"
            )
            engine = BatchEngine(cleared=cleared, watcher=display, asks=asks)
            return found, fly_search(found, options, cleared, engine, display.say)


def write_search_report(
    search: SearchCampaign, outcome: SearchOutcome, err: Callable[[str], object]
) -> Path | None:
    """Write the report of a search; return its path, or None after an error message to `err`."""
    try:
        return search_report.write_search_page(search, outcome)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - the results are whole
        why = f"{type(error).__name__}: {error}"
        name = search_report.FILE_NAME
        err(f"ERROR: {name} was not written ({why}); the results are complete without it")
        return None


def _require_person(found: SearchCampaign, options: FlightOptions) -> None:
    """Raise RefusedError where an attached vehicle would fly without a person who consents."""
    attached = attached_vehicles(found.flown)
    names = " and ".join(flown.name for flown in attached)
    where = "".join(f" of bench {bench.name}" for bench in found.campaign.benches)
    if not options.arm_real:
        raise FlightRefusedError(
            f"{names}{where}: a search flies no attached vehicle without --arm-real, and a person "
            "at the terminal who brings it back to its start and consents before each batch; else "
            "give a budget to mode sim alone, and fly the files of failures by `run`",
            REFUSED,
        )
    if options.engine != LOCAL:
        raise FlightRefusedError(
            f"--engine {options.engine}: {names} is attached to one machine, where consent to arm "
            "is given; search there with --engine local",
            REFUSED,
        )
    if not has_terminal():
        raise FlightRefusedError(
            f"{names}{where}: a search arms an attached vehicle only with a person at a terminal, "
            "who consents before each batch",
            REFUSED,
        )
    require_may_arm(found.campaign.benches, user_name())
