"""`wil-campaign run`: fly a campaign."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from campaigns.expansion.expansion import Campaign
from campaigns.schema import VEHICLES
from orchestrator.analysis.study_tables import has_modes_to_compare
from orchestrator.campaign.campaign_runner import (
    CampaignOutcome,
    FlyingSettings,
    fly_campaign,
)
from orchestrator.campaign.display_thread import Display
from orchestrator.campaign.folder.campaign_folder import OutputError, TakenError
from orchestrator.campaign.folder.repetitions import planned
from orchestrator.campaign.resuming.resumption import ResumeError
from orchestrator.campaign.workers.run_engine import EngineError
from orchestrator.cli.arming_consent import RefusedError
from orchestrator.cli.engine_flight import LOCAL, FlightOrder, ready_flight
from orchestrator.cli.final_report import write_final_report
from orchestrator.cli.progress_display import display_of, plain_console
from orchestrator.cli.run_selection import ALL, Choice
from orchestrator.cli.standard_streams import err, out
from orchestrator.cli.study_text import study_text
from orchestrator.cli.verdict_table import conclusions, verdict_table
from orchestrator.console.console_beside import console_beside
from orchestrator.console.errors import ConsoleError
from orchestrator.foxglove_bridge.bridge_beside import foxglove_beside
from orchestrator.foxglove_bridge.errors import BridgeError
from orchestrator.model.clock import Clock
from orchestrator.model.document_writer import to_json
from orchestrator.operator.errors import OperatingError
from orchestrator.report.campaign_report import WrittenReport


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class Flights:
    """How `run` flies.

    Parameters
    ----------
    clock
        virtual: as fast as the machine can, with results that are the same to the byte each time.
        wall: in real time, each vehicle in its own process on UDP. scaled: at the requested pace of
        the simulations, as far as they reach it. By default virtual; wall where the campaign has
        something external, such as an attached vehicle, a live camera, a simulator, a program or an
        outgoing stream; scaled where a simulation is launched at its own pace.
    jobs
        How many runs fly at once, each in its own process; by default one per core, on the wall
        clock one per two cores.
    broker
        An MQTT broker: mqtt://host, mqtts://host, or embedded, which starts one on this machine.
    gcs
        A ground station's LINK, or NAME=LINK for one vehicle (udpout://127.0.0.1:14550): the guard
        passes MAVLink on to it and back. It needs the wall clock; may be given several times.
    no_arm
        Try each case and mode once, up to arming: links, parameters, fence, readiness.
    arm_real
        Allow arming attached vehicles of the pair, which may be hardware.
    arm_actors
        Allow arming attached actors, which may be hardware and fly beside the pair.
    console
        A page in the browser to watch the flight and to stop it: HOST, HOST:PORT or :PORT
        of this machine; auto for a free port of 127.0.0.1. Its links are printed.
    foxglove
        Send runs in flight live to Foxglove, which only displays: HOST, HOST:PORT or :PORT of
        loopback; auto for 127.0.0.1:8765. It needs the extra foxglove.
    engine
        Where runs fly: local, in processes of this machine; ray, by a Ray started here for the
        campaign; ray://HOST:PORT, over the nodes of a Ray cluster that this machine is one of.
        It needs the extra cluster, and a folder --out that every node sees under the same path, or
        --store.
    store
        A URL that every node reaches, s3://BUCKET/PREFIX, through which results come into --out
        where no folder is shared. It needs the extra storage.
    """

    clock: Clock | None = None
    jobs: int | None = None
    broker: str | None = None
    gcs: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    no_arm: Annotated[bool, Parameter(name="--no-arm", negative=())] = False
    arm_real: Annotated[bool, Parameter(name="--arm-real", negative=())] = False
    arm_actors: Annotated[bool, Parameter(name="--arm-actors", negative=())] = False
    console: str | None = None
    foxglove: str | None = None
    engine: str = LOCAL
    store: str = ""


_USUAL = Flights()
AUTO = "auto"
_WIDEST = 1000
"""Columns of the console that measures a table without cutting it off."""


def run(
    file: Path,
    *,
    out_: Annotated[Path, Parameter(name="--out")] = Path("results"),
    choice: Choice = ALL,
    flights: Flights = _USUAL,
    resume: Annotated[bool, Parameter(negative=())] = False,
    again: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    junit: Path | None = None,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Fly a campaign and write its verdicts.

    Parameters
    ----------
    file
        The campaign file.
    out_
        The folder beneath which the results go: DIR/<campaign>/<UTC start>/.
    resume
        Resume an interrupted campaign: the newest beneath --out, or --out itself where that is a
        campaign's folder. Finished runs are kept, missing ones are flown; refused when the campaign
        or one of its files has changed. Give the same options as before.
    again
        With --resume: fly this run (case/mode/repetition) again, which proved nothing or was lost;
        may be given several times. Runs with a real vehicle are flown again only by this option.
    junit
        Write junit.xml here as well; the folder must exist.
    json_
        Print summary.json on standard output and nothing else there.
    """
    if flights.no_arm and resume:
        err("--no-arm leaves no results that --resume could continue")
        return 2
    if again and not resume:
        err(f"--again {again[0]} needs --resume")
        return 2
    options = choice.options(*_sets(flights))
    order = FlightOrder(
        file=file,
        options=options,
        out=out_,
        junit=junit,
        engine=flights.engine,
        store=flights.store,
        clock=flights.clock,
        jobs=flights.jobs,
        resume=resume,
        again=again,
        arm=not flights.no_arm,
        arm_real=flights.arm_real,
        arm_actors=flights.arm_actors,
    )
    try:
        with ready_flight(order) as (campaign, settings):
            return _fly_selected(campaign, settings, flights, json=json_)
    except (OutputError, TakenError) as error:
        err(error)
        return 3
    except (RefusedError, EngineError) as error:
        err(error)
        return error.code


def _sets(flights: Flights) -> list[str]:
    """Return the options of `run` for operators as overrides."""
    broker = [] if flights.broker is None else [f"operator.mqtt.broker={flights.broker}"]
    return _gcs_sets(flights.gcs) + broker


def _fly_selected(
    campaign: Campaign, settings: FlyingSettings, flights: Flights, *, json: bool
) -> int:
    """Fly the selected runs with a progress display; return the outcome."""
    display = display_of(json=json, total=len(planned(campaign, arm=settings.arm)))
    try:
        with display, _beside(flights, display, json=json):
            display.say(_announcement(campaign, settings))
            outcome = fly_campaign(campaign, settings, display)
    except (OutputError, OperatingError, ConsoleError) as error:
        err(error)
        return 3
    except (ResumeError, BridgeError) as error:
        err(error)
        return 2
    report = write_final_report(outcome.folder)
    if json:
        out(to_json(outcome.summary).rstrip())
    else:
        _print_verdicts(outcome, campaign, report)
    return outcome.exit_code


@contextmanager
def _beside(flights: Flights, display: Display, *, json: bool) -> Iterator[None]:
    """Run the requested console and Foxglove bridge beside a campaign."""
    # Standard output is one document with --json, and the links have to be seen.
    say = err if json else display.say
    with ExitStack() as stack:
        if flights.foxglove is not None:
            stack.enter_context(foxglove_beside(flights.foxglove, say, program=os.getpid()))
        if (address := flights.console) is not None:
            stack.enter_context(console_beside("127.0.0.1" if address == AUTO else address, say))
        yield


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


def _announcement(campaign: Campaign, settings: FlyingSettings) -> str:
    """Return the line that announces what `run` flies."""
    runs = len(planned(campaign, arm=settings.arm))
    at_once = min(settings.jobs, runs)
    return f"{campaign.name}: {runs} to fly, {at_once} at a time, {settings.clock} clock"


def _print_verdicts(
    outcome: CampaignOutcome, campaign: Campaign, report: WrittenReport | None
) -> None:
    """Print the verdict table of `run`, and where its report and its results are."""
    console = plain_console(soft_wrap=True)
    table = verdict_table(outcome.summary, campaign.requirements)
    # A narrower terminal wraps the lines, which is better than cells that are cut off.
    width = max(console.width, plain_console(width=_WIDEST).measure(table).maximum)
    plain_console(width=width).print(table)
    if report is not None and has_modes_to_compare(report.study):
        console.print(study_text(report.study))
    for line in conclusions(outcome.summary, campaign.requirements):
        console.print(line)
    if report is not None:
        console.print(f"report: {report.path}")
    console.print(f"results: {outcome.folder}")
