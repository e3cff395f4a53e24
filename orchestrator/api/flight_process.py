"""The process that flies a campaign for another program: request on stdin, messages on stdout.

It has none of the program's event loop, threads, signal handlers and main module, so that campaigns
fly the same from a script, a notebook and a test. All vehicles land when the program requests it,
or has ended, which closes standard input.
"""

import os
import signal
import sys
import threading
from collections.abc import Collection
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import BinaryIO, Self

from campaigns.expansion.expansion import Campaign, Options
from campaigns.setup.bench_file import load_benches
from orchestrator.api.flight_messages import (
    CampaignEnded,
    CampaignRefused,
    FlightMessage,
    FlightRequest,
    Message,
    RunFinished,
    decode_request,
    encode_line,
)
from orchestrator.campaign.campaign_runner import CampaignOutcome, fly_campaign
from orchestrator.campaign.display_thread import DisplayThread
from orchestrator.campaign.folder.campaign_folder import OutputError, TakenError
from orchestrator.campaign.resuming.resumption import ResumeError
from orchestrator.campaign.workers.run_engine import EngineError
from orchestrator.campaign.workers.run_server import start_run_server
from orchestrator.cli.arming_consent import RefusedError
from orchestrator.cli.engine_flight import LOCAL, FlightOrder, ready_flight
from orchestrator.cli.final_report import write_final_report
from orchestrator.model.progress import Progress
from orchestrator.model.results import RunResult
from orchestrator.operator.errors import OperatingError
from worlds.files.documents import BadInput


class MessageWatcher:
    """Sends the events of a campaign to the program that requested it."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def progress(self, progress: Progress) -> None:
        """Send nothing: programs receive finished runs only."""

    def finished(self, result: RunResult) -> None:
        """Send the result of a run."""
        self.send(RunFinished(result=result))

    def say(self, text: str) -> None:
        """Send a sentence about the campaign."""
        self.send(Message(text=text))

    def settle(self) -> None:
        """Wait for nothing: a call ends when all is sent."""

    def send(self, message: FlightMessage) -> None:
        """Send a message, unless the program has ended."""
        try:
            self._stream.write(encode_line(message))
            self._stream.flush()
        except OSError:
            pass


def main() -> int:
    """Fly the campaign that is requested on standard input."""
    commands = os.fdopen(os.dup(sys.stdin.fileno()), "rb")
    watcher = MessageWatcher(os.fdopen(os.dup(sys.stdout.fileno()), "wb"))
    # Prints of the user's code must not mix with messages, and no child may read the requests.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), sys.stdin.fileno())
    request = decode_request(commands.readline())
    if request.engine == LOCAL:
        start_run_server()
    threading.Thread(target=_stop_at_end, args=(commands,), daemon=True).start()
    ending = _fly_to_end(request, watcher)
    # All vehicles are down: when the program now closes standard input, nothing is interrupted.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    watcher.send(ending)
    return 0


def _stop_at_end(commands: BinaryIO) -> None:
    """Land all vehicles when standard input has another line, ends, or cannot be read."""
    with suppress(OSError):
        commands.readline()
    os.kill(os.getpid(), signal.SIGINT)


def _fly_to_end(request: FlightRequest, watcher: MessageWatcher) -> FlightMessage:
    """Fly the requested campaign; return the message about its end."""
    try:
        outcome = _fly_requested(request, watcher)
    except (RefusedError, EngineError) as error:
        return CampaignRefused(text=str(error), exit_code=error.code)
    except (BadInput, ResumeError) as error:
        return CampaignRefused(text=str(error), exit_code=2)
    except (OutputError, OperatingError, TakenError) as error:
        return CampaignRefused(text=str(error), exit_code=3)
    except KeyboardInterrupt:
        return CampaignRefused(text="interrupted before anything flew", exit_code=130)
    write_final_report(outcome.folder)
    return CampaignEnded(folder=str(outcome.folder), exit_code=outcome.exit_code)


def _fly_requested(request: FlightRequest, watcher: MessageWatcher) -> CampaignOutcome:
    options = Options(
        cases=request.cases,
        modes=request.modes,
        repetitions=request.repetitions,
        seed=request.seed,
        sets=request.sets,
        is_autonomy_isolated=True,
        benches=load_benches(map(Path, request.bench_files)),
    )
    order = FlightOrder(
        file=Path(request.file),
        options=options,
        out=Path(request.out),
        junit=None if request.junit is None else Path(request.junit),
        engine=request.engine,
        store=request.store,
        clock=request.clock,
        jobs=request.jobs,
        resume=request.resume,
        arm=request.arm,
        arm_real=request.arm_real,
        arm_actors=request.arm_actors,
        select=partial(_requested_runs, request),
    )
    # A program that is slow to read the messages must not keep its campaign from landing.
    with DisplayThread(watcher) as thread, ready_flight(order) as (campaign, settings):
        return fly_campaign(campaign, settings, thread)


def _requested_runs(request: FlightRequest, campaign: Campaign) -> Campaign:
    """Return a campaign with the requested runs. Raises RefusedError for one that it lacks."""
    if request.runs is None:
        return campaign
    known = {plan.name for plan in campaign.plans}
    if unknown := [name for name in request.runs if name not in known]:
        raise RefusedError(f"the campaign has no run '{unknown[0]}'", 2)
    return only_runs(campaign, frozenset(request.runs))


def only_runs(campaign: Campaign, names: Collection[str]) -> Campaign:
    """Return a campaign with only some of its runs and controls; `left_out` counts the others."""
    runs = tuple(plan for plan in campaign.runs if plan.name in names)
    controls = tuple(plan for plan in campaign.controls if plan.name in names)
    missing = len(campaign.plans) - len(runs) - len(controls)
    left_out = (f"{missing} of {len(campaign.plans)} runs and controls",) if missing else ()
    return replace(campaign, runs=runs, controls=controls, left_out=(*campaign.left_out, *left_out))


if __name__ == "__main__":
    sys.exit(main())
