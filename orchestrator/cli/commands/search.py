"""`wil-campaign search`: look for variants of a campaign that fail."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from campaigns.expansion.expansion import Options
from campaigns.search.search import most_flights
from campaigns.search.search_campaign import SearchCampaign
from campaigns.search.search_file import load_search
from campaigns.search.strategies import MissingExtraError
from orchestrator.campaign.attached_vehicles import attached_vehicles
from orchestrator.campaign.campaign_folder import OutputError, require_writable
from orchestrator.campaign.resumption import ResumeError
from orchestrator.campaign.run_server import start_run_server
from orchestrator.cli.arming_consent import Cleared, RefusedError, clear
from orchestrator.cli.progress_display import display_of
from orchestrator.cli.search_report import write_search_report
from orchestrator.cli.search_text import search_text
from orchestrator.cli.standard_streams import err, ignore_broken_pipe, out
from orchestrator.model.clock import Clock
from orchestrator.operator.errors import OperatingError
from orchestrator.search.engine import LocalEngine
from orchestrator.search.errors import SearchError
from orchestrator.search.search_document import FILE_NAME
from orchestrator.search.search_runner import SearchOutcome, SearchSettings, fly_search


def search(
    file: Path,
    *,
    out_: Annotated[Path, Parameter(name="--out")] = Path("results"),
    seed: int | None = None,
    set_: Annotated[tuple[str, ...], Parameter(name="--set", negative=())] = (),
    clock: Clock | None = None,
    jobs: int | None = None,
    resume: Annotated[bool, Parameter(negative=())] = False,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Look for variants of a campaign that fail, as its `search` says; confirm and reduce them.

    Exit code 1: a failure is confirmed, and has a campaign file of its own. 0: none is. 3: what
    failed is neither confirmed nor refuted, or half of the variants or more proved nothing.

    Parameters
    ----------
    file
        The campaign file.
    out_
        The folder beneath which the results go: DIR/<campaign>/search/<UTC start>/.
    seed
        The seed from which proposals and runs derive.
    set_
        KEY=VALUE: a dotted key of the campaign, or of world.* or recipe.*, and its value.
    clock
        virtual, wall or scaled, as of `run`.
    jobs
        How many runs fly at once; so many flights are proposed at once.
    resume
        Go on with the search that was cut off: the newest beneath --out, or --out itself where
        that is a search's folder. Refused when one of its files has changed.
    json_
        Print search.json on standard output and nothing else there.
    """
    found = load_search(file, Options(seed=seed, sets=set_))
    if attached := attached_vehicles(found.campaign):
        names = " and ".join(one.name for one in attached)
        err(
            f"{names}: a search flies no attached vehicle, for nobody brings it back to its start "
            "between proposals; search in mode sim, and fly the files of failures by `run`"
        )
        return 2
    start_run_server()
    try:
        require_writable(out_, junit=None)
        cleared = clear(found.campaign, clock=clock, jobs=jobs, arm=True, arm_real=False)
    except OutputError as error:
        err(error)
        return 3
    except RefusedError as error:
        err(error)
        return error.code
    settings = SearchSettings(out=out_, clock=cleared.clock, at_once=cleared.jobs, resume=resume)
    try:
        outcome = _fly(found, settings, cleared, json=json_)
    except (OutputError, OperatingError) as error:
        err(error)
        return 3
    except (ResumeError, SearchError, MissingExtraError) as error:
        err(error)
        return 2
    _print(found, outcome, json=json_)
    return outcome.exit_code


def _fly(
    found: SearchCampaign, settings: SearchSettings, cleared: Cleared, *, json: bool
) -> SearchOutcome:
    """Fly a search with a progress display."""
    most = most_flights(found.problem(at_once=settings.at_once))
    display = display_of(json=json, total=most)
    with display:
        strategy = found.part.strategy
        display.say(
            f"{found.campaign.name}: search by {strategy}, at most {most} flights, "
            f"{settings.at_once} at a time, {settings.clock} clock"
        )
        engine = LocalEngine(
            clock=cleared.clock, jobs=cleared.jobs, real_kind=cleared.real_kind, watcher=display
        )
        return fly_search(found, settings, engine, display.say)


def _print(found: SearchCampaign, outcome: SearchOutcome, *, json: bool) -> None:
    """Print what a search found, and where its report and its results are."""
    report = write_search_report(found, outcome)
    if json:
        out((outcome.folder / FILE_NAME).read_text("utf-8").rstrip())
        return
    console = Console(file=ignore_broken_pipe(), highlight=False, soft_wrap=True, markup=False)
    console.print(search_text(found, outcome))
    if report is not None:
        console.print(f"report: {report}")
    console.print(f"results: {outcome.folder}")
