"""`wil-campaign search`: searches for variants of a campaign that fail."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from campaigns.expansion.expansion import Options
from campaigns.search.search import most_flights
from campaigns.search.search_campaign import SearchCampaign
from campaigns.search.search_file import load_search
from campaigns.search.strategies import MissingExtraError
from campaigns.setup.bench_file import load_benches
from orchestrator.campaign.folder.campaign_folder import OutputError, require_writable
from orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from orchestrator.campaign.resuming.resumption import ResumeError
from orchestrator.campaign.workers.run_engine import EngineError, RunEngine
from orchestrator.campaign.workers.run_server import start_run_server
from orchestrator.cli.arming_consent import Cleared, RefusedError, clear
from orchestrator.cli.engine_flight import LOCAL, result_store, runs_engine
from orchestrator.cli.final_report import write_search_report
from orchestrator.cli.progress_display import display_of, plain_console
from orchestrator.cli.search_text import search_text
from orchestrator.cli.standard_streams import err, out
from orchestrator.engines.ray_engine import engine_address
from orchestrator.model.clock import Clock
from orchestrator.operator.errors import OperatingError
from orchestrator.search.engine import BatchEngine
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
    engine: str = LOCAL,
    store: str = "",
    bench_file: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Look for variants of a campaign that fail, as its `search` says; confirm and reduce them.

    Exit code 1: a failure is confirmed, and has its own campaign file. 0: no failure is confirmed.
    3: failures are neither confirmed nor refuted, or at least half of the variants proved nothing.

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
        How many runs fly at once, which is also how many flights are proposed at once.
    resume
        Resume an interrupted search: the newest beneath --out, or --out itself where
        that is a search's folder. Refused when one of its files has changed.
    engine
        Where runs fly, as of `run`: local, ray, or ray://HOST:PORT.
    store
        The store through which results come, as of `run`: s3://BUCKET/PREFIX.
    bench_file
        A bench of this machine, whose fence the search keeps; may be given several times. Its
        vehicle is not flown by a search.
    json_
        Print search.json on standard output and nothing else there.
    """
    try:
        if engine != LOCAL:
            engine_address(engine)  # before anything is read
        result_store(store, engine)
        options = Options(
            seed=seed, sets=set_, is_autonomy_isolated=True, benches=load_benches(bench_file)
        )
        found = load_search(file, options)
        _refuse_attached(found)
        start_run_server()
        require_writable(out_, junit=None)
        cleared = clear(found.flown, clock=clock, jobs=jobs, arm=True, arm_real=False)
        most = most_flights(found.problem(at_once=cleared.jobs))
        with runs_engine(
            engine, found.flown, cleared, store=store, jobs=jobs, runs=most, again=True
        ) as runs:
            cleared = replace(cleared, jobs=runs[1])
            settings = SearchSettings(
                out=out_, clock=cleared.clock, at_once=cleared.jobs, resume=resume
            )
            outcome = _fly(found, settings, cleared, runs[0], json=json_)
    except (OutputError, OperatingError) as error:
        err(error)
        return 3
    except (RefusedError, EngineError) as error:
        err(error)
        return error.code
    except (ResumeError, SearchError, MissingExtraError) as error:
        err(error)
        return 2
    _print(found, outcome, json=json_)
    return outcome.exit_code


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


def _fly(
    found: SearchCampaign,
    settings: SearchSettings,
    cleared: Cleared,
    runs: RunEngine,
    *,
    json: bool,
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
        engine = BatchEngine(
            clock=cleared.clock,
            jobs=cleared.jobs,
            real_kind=cleared.real_kind,
            watcher=display,
            runs=runs,
        )
        return fly_search(found, settings, engine, display.say)


def _print(found: SearchCampaign, outcome: SearchOutcome, *, json: bool) -> None:
    """Print the result of a search, and where its report and its results are."""
    report = write_search_report(found, outcome)
    if json:
        out((outcome.folder / FILE_NAME).read_text("utf-8").rstrip())
        return
    console = plain_console(soft_wrap=True)
    console.print(search_text(found, outcome))
    if report is not None:
        console.print(f"report: {report}")
    console.print(f"results: {outcome.folder}")
