"""The process that flies a campaign for another program: request on stdin, messages on stdout.

It has none of the program's event loop, threads, signal handlers and main module, so that campaigns
fly the same from a script, a notebook and a test. All vehicles land when the program requests it,
or has ended, which closes standard input.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Self

from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.orchestrator.campaign.campaign_runner import fly_campaign
from wil_campaign.orchestrator.campaign.display_thread import DisplayThread
from wil_campaign.orchestrator.campaign.folder.campaign_folder import FolderTakenError, OutputError
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import ResumeError
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.cli.arming_consent import FlightRefusedError
from wil_campaign.orchestrator.cli.engine_flight import ready_flight
from wil_campaign.orchestrator.cli.final_report import write_final_report
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.orchestrator.operator.run_messages import RunProgressReport
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.python.flight_messages import (
    CampaignEnded,
    CampaignMessage,
    CampaignRefused,
    FlightMessage,
    RunFinished,
    decode_request,
    encode_line,
)
from wil_campaign.safety.guard.process.runtime_folder import RuntimeFolderError


class MessageWatcher:
    """Sends the events of a campaign to the program that requested it."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def progress(self, progress: RunProgressReport) -> None:
        """Send nothing: programs receive finished runs only."""

    def finished(self, result: RunResult) -> None:
        """Send the result of a run."""
        self.send(RunFinished(result=result))

    def say(self, text: str) -> None:
        """Send a sentence about the campaign."""
        self.send(CampaignMessage(text=text))

    def settle(self) -> None:
        """Wait for nothing: a call ends when all is sent."""

    def send(self, message: FlightMessage) -> None:
        """Send a message, unless the program has ended."""
        try:
            self._stream.write(encode_line(message))
            self._stream.flush()
        except OSError:
            pass


Fly = Callable[[bytes, MessageWatcher], CampaignEnded]
"""Flies the request of a line; returns how it ended, or raises what `run` reports."""


def main() -> int:
    """Fly the campaign that is requested on standard input."""
    return serve_flight_request(_fly_campaign)


def serve_flight_request(fly: Fly) -> int:
    """Fly what is requested on standard input, and send its messages to standard output."""
    commands = os.fdopen(os.dup(sys.stdin.fileno()), "rb")
    watcher = MessageWatcher(os.fdopen(os.dup(sys.stdout.fileno()), "wb"))
    # Prints of the user's code must not mix with messages, and no child may read the requests.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), sys.stdin.fileno())
    request = commands.readline()
    threading.Thread(target=_stop_at_end, args=(commands,), daemon=True).start()
    ending = _fly_to_end(fly, request, watcher)
    # All vehicles are down: when the program now closes standard input, nothing is interrupted.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    watcher.send(ending)
    return 0


def _stop_at_end(commands: BinaryIO) -> None:
    """Land all vehicles when standard input has another line, ends, or cannot be read."""
    with suppress(OSError):
        commands.readline()
    os.kill(os.getpid(), signal.SIGINT)


def _fly_to_end(fly: Fly, request: bytes, watcher: MessageWatcher) -> FlightMessage:
    """Fly a request; return the message about its end."""
    try:
        return fly(request, watcher)
    except (FlightRefusedError, EngineError) as error:
        return CampaignRefused(text=str(error), exit_code=error.code)
    except (BadInput, ResumeError, RuntimeFolderError) as error:
        return CampaignRefused(text=str(error), exit_code=2)
    except (OutputError, OperatingError, FolderTakenError) as error:
        return CampaignRefused(text=str(error), exit_code=3)
    except KeyboardInterrupt:
        return CampaignRefused(text="interrupted before anything flew", exit_code=130)


def _fly_campaign(line: bytes, watcher: MessageWatcher) -> CampaignEnded:
    request = decode_request(line)
    ready = ready_flight(request.file, request.choice.options(), request.options)
    # A program that is slow to read the messages must not keep its campaign from landing.
    with DisplayThread(watcher) as thread, ready as (campaign, cleared):
        outcome = fly_campaign(campaign, request.options, cleared, thread)
    with suppress(KeyboardInterrupt):  # all is flown: the results are whole without a report
        write_final_report(outcome.folder)
    return CampaignEnded(folder=str(outcome.folder), exit_code=outcome.exit_code)


if __name__ == "__main__":
    sys.exit(main())
