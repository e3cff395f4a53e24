"""`wil-campaign run`: fly a campaign."""

import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.text import Text

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.campaigns.schema import VEHICLES
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.hooks import LiveViewError, live_views, run_options
from wil_campaign.installed_plugins import absent_additions, plugin_additions
from wil_campaign.orchestrator.campaign.campaign_runner import CampaignOutcome, fly_campaign
from wil_campaign.orchestrator.campaign.flight_options import USUAL, ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import (
    FolderTakenError,
    OutputError,
    remove_earlier_junit,
)
from wil_campaign.orchestrator.campaign.folder.repetitions import runs_planned
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import ResumeError
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.cli.announcements import announce_verdicts
from wil_campaign.orchestrator.cli.arming_consent import FlightRefusedError
from wil_campaign.orchestrator.cli.engine_flight import ready_flight
from wil_campaign.orchestrator.cli.final_report import name_problems, write_final_report
from wil_campaign.orchestrator.cli.flight_needs import (
    compilation_notice,
    disk_warning,
    flight_needs,
    images_mb_of,
    needs_text,
)
from wil_campaign.orchestrator.cli.live_views import views_beside
from wil_campaign.orchestrator.cli.plugin_options import (
    NO_OPTIONS,
    PluginOptions,
    given_options,
    takes_options,
)
from wil_campaign.orchestrator.cli.progress_display import plain_console, progress_display_of
from wil_campaign.orchestrator.cli.run_selection import ALL, RunSelection
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.cli.text_table import count_text
from wil_campaign.orchestrator.cli.verdict_table import (
    conclusion_lines,
    explained_words,
    next_steps,
    verdict_table,
)
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.orchestrator.report.campaign_report import WrittenReport

_WIDEST = 1000
"""Columns of the console that measures a table without cutting it off."""


@takes_options(live_views, "views", str | None)
@takes_options(run_options, "keys", str | None)
def run(
    file: Path,
    *,
    choice: RunSelection = ALL,
    options: FlightOptions = USUAL,
    keys: PluginOptions = NO_OPTIONS,
    gcs: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    no_arm: Annotated[bool, Parameter(name="--no-arm", negative=())] = False,
    views: PluginOptions = NO_OPTIONS,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Fly a campaign and write its verdicts.

    Parameters
    ----------
    file
        The campaign file.
    gcs
        A ground station's LINK, or NAME=LINK for one vehicle (udpout://127.0.0.1:14550): the guard
        forwards MAVLink to it, and from it only messages that read or take over. It needs the
        wall clock; may be given several times.
    no_arm
        Try each case and mode once, up to arming: links, parameters, fence, readiness.
    json_
        Print summary.json on standard output and nothing else there.
    """
    if options.junit is not None:
        remove_earlier_junit(options.junit)  # before any refusal
    if no_arm and options.resume:
        write_stderr("--no-arm leaves no results that --resume could continue")
        return 2
    if options.again and not options.resume:
        write_stderr(f"--again {options.again[0]} needs --resume")
        return 2
    for name in given_options(keys):
        if why := absent_additions(run_options).get(name):
            write_stderr(why)
            return 2
    options = replace(options, arm=not no_arm)
    selection = choice.options(*_gcs_sets(gcs), *_key_sets(keys))
    flown = (str(file), *RunSelection.of(selection).words)
    try:
        with ready_flight(file, selection, options) as (campaign, cleared):
            return _fly_selected(campaign, options, cleared, views, flown, json=json_)
    except (OutputError, FolderTakenError) as error:
        write_stderr(error)
        return 3
    except (FlightRefusedError, EngineError) as error:
        write_stderr(error)
        return error.code


def _key_sets(keys: PluginOptions) -> list[str]:
    known = plugin_additions(run_options)
    return [f"{known[name].key}={value}" for name, value in given_options(keys).items()]


def _fly_selected(
    campaign: Campaign,
    options: FlightOptions,
    cleared: ClearedCampaign,
    views: PluginOptions,
    flown: Sequence[str],
    *,
    json: bool,
) -> int:
    """Fly the selected runs with a progress display; return the outcome."""
    display = progress_display_of(json=json, total=len(runs_planned(campaign, arm=options.arm)))
    try:
        # Standard output is one document with --json, and the lines have to be seen.
        say = write_stderr if json else display.say
        with display, views_beside(views, say, program=os.getpid()):
            for line in _announcement(campaign, options, cleared):
                display.say(line)
            if notice := compilation_notice(campaign):
                display.say(notice)
            outcome = fly_campaign(campaign, options, cleared, display)
    except (OutputError, OperatingError) as error:
        write_stderr(error)
        return 3
    except ResumeError as error:
        write_stderr(error)
        return 2
    except LiveViewError as error:
        write_stderr(error)
        return error.code
    report = write_final_report(outcome.folder)
    if report is not None and outcome.summary.stopped is None:
        name_problems(report.problems)  # as files that somebody removed in flight
    if json:
        write_stdout(to_json(outcome.summary).rstrip())
    else:
        steps = next_steps(
            outcome.summary,
            flown=flown,
            clock=options.clock,
            folder=outcome.folder,
            has_report=report is not None,
        )
        _print_verdicts(outcome, campaign, report, steps)
    announce_verdicts(campaign, outcome.summary, outcome.folder, arm=options.arm)
    return outcome.exit_code


def _gcs_sets(links: tuple[str, ...]) -> list[str]:
    """Return --gcs as overrides of the run; a link without a vehicle's name is both's."""
    sets: list[str] = []
    for text in links:
        name, is_named, link = text.partition("=")
        sets += [
            f"operator.gcs.{one}={link if is_named else text}"
            for one in ((name,) if is_named else VEHICLES)
        ]
    return sets


def _announcement(
    campaign: Campaign, options: FlightOptions, cleared: ClearedCampaign
) -> Iterator[str]:
    """Yield the line that announces what `run` flies, and a warning of much disk."""
    plans = runs_planned(campaign, arm=options.arm)
    runs, at_once = len(plans), min(cleared.jobs, len(plans))
    images_mb = [images_mb_of(campaign.setups[plan.case], plan.mode) for plan in plans]
    needs = flight_needs(options.out / campaign.name, cleared.clock, images_mb=images_mb)
    flights, needed = count_text(runs, "flight"), needs_text(needs, flights=runs, at_once=at_once)
    yield f"{campaign.name}: {flights}, {at_once} at a time, {cleared.clock} clock; {needed}"
    there = next(path for path in (options.out, *options.out.resolve().parents) if path.exists())
    free_mb = shutil.disk_usage(there).free / 1e6
    if warning := disk_warning(needs, flights=runs, free_mb=free_mb):
        yield warning


def _print_verdicts(
    outcome: CampaignOutcome,
    campaign: Campaign,
    report: WrittenReport | None,
    steps: Sequence[Text],
) -> None:
    """Print the verdict table of `run`, where its report and its results are, and what is next."""
    console = plain_console(soft_wrap=True)
    table = verdict_table(outcome.summary, campaign.requirements)
    # A narrower terminal wraps the lines, which is better than cells that are cut off.
    width = max(console.width, plain_console(width=_WIDEST).measure(table).maximum)
    plain_console(width=width).print(table)
    for line in explained_words(outcome.summary):
        console.print(line)
    console.print()
    for text in () if report is None else report.texts:
        console.print(text)
    for line in conclusion_lines(
        outcome.summary, campaign.requirements, announced=outcome.announced
    ):
        console.print(line)
    if report is not None:
        console.print(f"report: {report.path}")
    console.print(f"results: {outcome.folder}")
    for line in steps:
        console.print(line)
