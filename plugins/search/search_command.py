"""`wil-campaign search`: searches for variants of a campaign that fail.

The result of a search as text: a table of failures, and the sentences beneath it.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.campaigns.expansion.expansion import ExpansionOptions
from wil_campaign.campaigns.setup.bench_file import load_benches
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.orchestrator.campaign.display_thread import DisplayThread, ProgressDisplay
from wil_campaign.orchestrator.campaign.flight_options import FlightOptions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import FolderTakenError, OutputError
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import ResumeError
from wil_campaign.orchestrator.campaign.workers.run_engine import LOCAL, EngineError
from wil_campaign.orchestrator.cli.arming_consent import FlightRefusedError
from wil_campaign.orchestrator.cli.engine_flight import check_engine, result_store
from wil_campaign.orchestrator.cli.progress_display import (
    LineDisplay,
    plain_console,
    progress_display_of,
)
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.cli.text_table import table_lines
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.plugins.search.errors import SearchError
from wil_campaign.plugins.search.exploration.coverage import space_coverage_of
from wil_campaign.plugins.search.exploration.model import FailingCase
from wil_campaign.plugins.search.exploration.search_campaign import SearchCampaign
from wil_campaign.plugins.search.exploration.strategies import MissingExtraError
from wil_campaign.plugins.search.search_document import BROKEN, FILE_NAME, unsettled_texts
from wil_campaign.plugins.search.search_flight import fly_search_file, write_search_report
from wil_campaign.plugins.search.search_runner import SearchOutcome


def search_text(search: SearchCampaign, outcome: SearchOutcome) -> str:
    """Return the result of a search, for a terminal."""
    found = outcome.findings
    rows = [
        (
            failing_case.variant.name,
            failing_case.mode,
            failing_case.standing,
            f"{failing_case.failed}/{failing_case.proven}",
            _interval_text(failing_case),
            failing_case.causes_text,
            search.space.text(failing_case.reduced.values)
            if failing_case.standing == "confirmed"
            else "",
            outcome.files.get(failing_case.variant.name, ""),
        )
        for failing_case in found.cases
    ]
    heads = ("variant", "mode", "standing", "failed", "rate", "cause", "reduced to", "file")
    shown = [f"{table_lines(heads, rows)}\n"] if rows else []
    return "\n".join([*shown, *_sentences(search, outcome)])


def _sentences(search: SearchCampaign, outcome: SearchOutcome) -> Iterator[str]:
    found = outcome.findings
    failed = sum(tried_variant.failed_last(found.modes) for tried_variant in found.tried)
    yield (
        f"{search.campaign.name}: {len(found.tried)} variants flown, {failed} failed, "
        f"{len(found.confirmed)} confirmed; {len(found.refused)} refused before a flight; "
        f"{outcome.ended}"
    )
    if outcome.is_broken:
        yield BROKEN
    yield from unsettled_texts(found)
    for gap in found.gaps:
        spread = "" if gap.spread is None else f", spread {gap.spread:.3f}"
        mean = "not measured" if gap.mean is None else f"mean {gap.mean:+.3f}{spread}"
        pairs = len(gap.differences)
        yield f"gap from {gap.lower} to {gap.upper}: {mean} of the objective, by {pairs} pairs"
    for (mode, purpose), cost in found.costs.items():
        yield f"{mode}, {purpose}: {cost.flights} flights, {cost.flight_s:.0f} s in flight"
    covered = space_coverage_of(search.space, found.proven_values)
    yield f"coverage: {covered.flown} of {covered.cells} pairs of cells ({covered.share:.0%})"


def _interval_text(case: FailingCase) -> str:
    return "" if case.interval is None else case.interval.rate_text


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
    arm_real: Annotated[bool, Parameter(negative=())] = False,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Look for variants of a campaign that fail, as its `search` says; confirm and reduce them.

    Exit code 1: a failure is confirmed, and has its own campaign file. 0: no failure is confirmed.
    3: failures are neither confirmed nor refuted, or at least half of the variants of a mode proved
    nothing.

    Parameters
    ----------
    file
        The campaign file.
    out_
        The folder for the results: DIR/<campaign>/search/<UTC start>/.
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
        A bench of this machine, whose fence the search keeps; may be given several times.
    arm_real
        Allow arming attached vehicles, which may be hardware, in the modes that the budget has. It
        needs a person at the terminal, who is asked before each batch.
    json_
        Print search.json on standard output and nothing else there.
    """
    options = FlightOptions(
        out=out_,
        clock=clock,
        jobs=jobs,
        resume=resume,
        engine=engine,
        store=store,
        arm_real=arm_real,
    )
    try:
        check_engine(engine)  # before anything is read
        result_store(options)
        selection = ExpansionOptions(
            seed=seed, sets=set_, is_autonomy_isolated=True, benches=load_benches(bench_file)
        )
        found, outcome = fly_search_file(
            file, selection, options, partial(_display, json=json_, asks=arm_real)
        )
    except (OutputError, OperatingError, FolderTakenError) as error:
        write_stderr(error)
        return 3
    except (FlightRefusedError, EngineError) as error:
        write_stderr(error)
        return error.code
    except (ResumeError, SearchError, MissingExtraError) as error:
        write_stderr(error)
        return 2
    _print(found, outcome, json=json_)
    return outcome.exit_code


def _display(total: int, *, json: bool, asks: bool) -> ProgressDisplay:
    """Return the progress display of at most `total` flights. asks: a person between them."""
    if asks and not json:
        # Nothing is drawn again over a question.
        return DisplayThread(LineDisplay(console=plain_console(soft_wrap=True), total=total))
    return progress_display_of(json=json, total=total)


def _print(found: SearchCampaign, outcome: SearchOutcome, *, json: bool) -> None:
    """Print the result of a search, and where its report and its results are."""
    report = write_search_report(found, outcome, write_stderr)
    if json:
        write_stdout((outcome.folder / FILE_NAME).read_text("utf-8").rstrip())
        return
    console = plain_console(soft_wrap=True)
    console.print(search_text(found, outcome))
    if report is not None:
        console.print(f"report: {report}")
    console.print(f"results: {outcome.folder}")
