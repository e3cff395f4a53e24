"""Flies a campaign for a Python program in a separate process: blocking, or awaited."""

import asyncio
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from functools import cache, partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, requested_bench
from wil_campaign.orchestrator.campaign.flight_options import USUAL, FlightOptions
from wil_campaign.orchestrator.campaign.workers.run_engine import LOCAL
from wil_campaign.orchestrator.cli.run_selection import ALL, RunSelection
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.python.campaign_results import CampaignResults, read_results
from wil_campaign.plugins.python.flight_messages import (
    CampaignEnded,
    CampaignMessage,
    CampaignRefused,
    FlightMessage,
    FlightRequest,
    RunFinished,
    decode_message,
    encode_request,
)
from wil_campaign.plugins.python.loading import load
from wil_campaign.plugins.python.several import as_several

_MODULE = "wil_campaign.plugins.python.flight_process"
T = TypeVar("T")
OnResult = Callable[[RunResult], object]
OnMessage = Callable[[str], object]


class CannotFlyError(Exception):
    """A campaign cannot be flown, or its results cannot be written; says why.

    exit_code: what `wil-campaign run` would have ended with, 2 or 3; 130 when interrupted.
    """

    def __init__(self, text: str, exit_code: int) -> None:
        super().__init__(text)
        self.exit_code = exit_code


def run(
    campaign: Campaign | str | Path,
    options: FlightOptions = USUAL,
    *,
    bench_files: Sequence[str | Path] = (),
    on_result: OnResult | None = None,
    on_message: OnMessage | None = None,
    **overrides: Any,
) -> CampaignResults:
    """Fly a campaign and return its results when the last vehicle is down.

    campaign: a loaded one, or a file. options, overrides: the fields of FlightOptions, those of
    `options` or by name (`out="results"`); no person is asked before an attached vehicle is armed,
    and on a bench of a cluster, for which the campaign is given as a file, consent to arm is given
    on the bench's own terminal. bench_files: as of `load`, where the campaign is given as a file.
    on_result: called with the result of each run as it ends; on_message: with sentences for people.

    Ctrl-C lands all vehicles, then raises KeyboardInterrupt; so does an exception of on_result or
    on_message, which is then raised. Raises BadInput for faults of files, CannotFlyError.
    """
    request = _request(campaign, flight_options_with(options, overrides), bench_files)
    with FlightProcess(encode_request(request)) as process:
        return _flown(process, on_result or _ignore, on_message or _ignore)


async def run_async(
    campaign: Campaign | str | Path,
    options: FlightOptions = USUAL,
    *,
    bench_files: Sequence[str | Path] = (),
    on_result: OnResult | None = None,
    on_message: OnMessage | None = None,
    **overrides: Any,
) -> CampaignResults:
    """Fly a campaign as `run` does, while the event loop continues.

    on_result and on_message are called in the loop, which handles what they raise. A cancelled call
    lands all vehicles first, and raises CancelledError when they are down.
    """
    request = await asyncio.to_thread(
        _request, campaign, flight_options_with(options, overrides), bench_files
    )
    process = FlightProcess(encode_request(request))
    return await await_flight_landing(
        process, _flown, call_in_loop(on_result or _ignore), call_in_loop(on_message or _ignore)
    )


def flight_options_with(options: FlightOptions, overrides: Mapping[str, Any]) -> FlightOptions:
    """Return options with some fields replaced; paths may be text, and any collection a tuple.

    Raises TypeError for a name that is no field, ValueError for a value that a field cannot have,
    and for `again` without `resume`.
    """
    texts: dict[str, Callable[[Any], Any]] = {"out": Path, "junit": Path}
    texts |= {"again": as_several, "runs": as_several}
    values = {
        name: texts[name](value) if name in texts and value is not None else value
        for name, value in overrides.items()
    }
    chosen = replace(options, **values)
    if chosen.again and not chosen.resume:
        raise ValueError(f"again={chosen.again!r}: needs resume=True")
    given = {each.name: getattr(chosen, each.name) for each in fields(chosen)}
    try:
        return _options_model().validate_python(given)
    except ValidationError as error:
        raise ValueError("; ".join(map(_fault, error.errors()))) from None


@cache
def _options_model() -> TypeAdapter[FlightOptions]:
    return TypeAdapter(FlightOptions)


def _fault(found: ErrorDetails) -> str:
    """Return a fault of flight options: of which field, and what it may be."""
    what = found["msg"].removeprefix("Input ")
    return f"{found['loc'][0]}={found['input']!r}: {what}"


def call_in_loop(call: Callable[[T], object]) -> Callable[[T], object]:
    """Return a function that makes a call in the present event loop, from another thread."""
    loop = asyncio.get_running_loop()
    return lambda value: loop.call_soon_threadsafe(partial(call, value))


async def await_flight_landing(
    process: "FlightProcess", wait: Callable[..., T], *arguments: object
) -> T:
    """Await a flight, in a thread that calls `wait`; at each cancellation, land it and wait on.

    Raises CancelledError then, from what the flight raises.
    """
    loop = asyncio.get_running_loop()
    waiting = loop.run_in_executor(None, partial(_wait_for, process, wait, *arguments))
    cancelled: asyncio.CancelledError | None = None
    while not waiting.done():
        try:
            await asyncio.wait([waiting])
        except asyncio.CancelledError as error:
            cancelled = error
            process.stop()
    if cancelled is not None:
        raise cancelled from waiting.exception()
    return waiting.result()


def _wait_for(process: "FlightProcess", wait: Callable[..., T], *arguments: object) -> T:
    with process:
        return wait(process, *arguments)


def _flown(process: "FlightProcess", on_result: OnResult, on_message: OnMessage) -> CampaignResults:
    """Return the results of a flight when it is over."""
    ended = process.wait(on_result, on_message)
    return read_results(ended.folder, exit_code=ended.exit_code)


class FlightProcess:
    """A process that flies one request; leaving the context lands what still flies.

    module: that serves the request (`flight_process.serve`).
    """

    def __init__(self, request: bytes, module: str = _MODULE) -> None:
        # Its own session: Ctrl-C reaches only the program, which then requests the landing once.
        self._process = subprocess.Popen(  # noqa: S603 - our own interpreter
            [sys.executable, "-P", "-m", module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        self._is_stopped = False
        self._send(request)

    def __enter__(self) -> Self:
        """Return the process."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Land what still flies, wait for it, and close the pipes."""
        if kind is not None:
            self.stop()
            for _ in iter(self._read, None):
                pass
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                # If the process has ended, the last request may still be in the pipe's buffer.
                with suppress(BrokenPipeError):
                    stream.close()
        self._process.wait()

    def wait(self, on_result: OnResult, on_message: OnMessage) -> CampaignEnded:
        """Return how the campaign ended when it is over. Raises CannotFlyError."""
        for message in iter(self._read, None):
            match message:
                case CampaignEnded():
                    return message
                case CampaignRefused(text=text, exit_code=code):
                    raise CannotFlyError(text, code)
                case RunFinished(result=result):
                    on_result(result)
                case CampaignMessage(text=text):
                    on_message(text)
        code = self._process.wait()
        raise CannotFlyError(f"the process that flew the campaign ended with code {code}", 3)

    def stop(self) -> None:
        """Land all vehicles; a second call changes nothing."""
        if not self._is_stopped:
            self._is_stopped = True
            self._send(b"stop\n")

    def _send(self, line: bytes) -> None:
        stream = self._process.stdin
        if stream is not None:
            try:
                stream.write(line)
                stream.flush()
            except (BrokenPipeError, ValueError):
                pass  # the process has ended, or its pipe is closed: its messages tell how

    def _read(self) -> FlightMessage | None:
        """Return the next message; None at the end."""
        stream = self._process.stdout
        line = b"" if stream is None else stream.readline()
        return decode_message(line) if line else None


def _request(
    campaign: Campaign | str | Path, options: FlightOptions, bench_files: Sequence[str | Path]
) -> FlightRequest:
    """Return the request to fly a campaign, which is loaded first.

    One that first has to reserve a bench of a cluster is not. Raises BadInput, ValueError,
    CannotFlyError for an unknown run.
    """
    if isinstance(campaign, Campaign):
        if bench_files:
            raise ValueError("bench_files: the campaign is loaded; give them to load()")
    else:
        file = Path(campaign)
        asks = options.engine != LOCAL and not bench_files
        if asks and requested_bench(file, ExpansionOptions()) is not None:
            return FlightRequest(file=file, choice=ALL, options=options)
        campaign = load(file, bench_files=bench_files)
    known = {plan.name for plan in campaign.plans}
    if unknown := [name for name in options.runs or () if name not in known]:
        raise CannotFlyError(f"the campaign has no run '{unknown[0]}'", 2)
    choice = RunSelection.of(campaign.options)
    return FlightRequest(file=campaign.document.path, choice=choice, options=options)


def _ignore(_: object) -> None:
    """Ignore an event."""
