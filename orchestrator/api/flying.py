"""Flies a campaign for a Python program in a separate process: blocking, or awaited."""

import asyncio
import os
import subprocess
import sys
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from campaigns.expansion.expansion import Campaign, Options, requested_bench
from orchestrator.api.campaign_results import CampaignResults, read_results
from orchestrator.api.flight_messages import (
    CampaignEnded,
    CampaignRefused,
    FlightMessage,
    FlightRequest,
    Message,
    RunFinished,
    decode_message,
    encode_line,
)
from orchestrator.api.loading import load
from orchestrator.cli.engine_flight import LOCAL
from orchestrator.model.clock import Clock
from orchestrator.model.results import RunResult

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
    *,
    out: str | Path = "results",
    runs: Collection[str] | None = None,
    clock: Clock | None = None,
    jobs: int | None = None,
    resume: bool = False,
    arm: bool = True,
    arm_real: bool = False,
    arm_actors: bool = False,
    junit: str | Path | None = None,
    engine: str = LOCAL,
    store: str = "",
    bench_files: Sequence[str | Path] = (),
    on_result: OnResult | None = None,
    on_message: OnMessage | None = None,
) -> CampaignResults:
    """Fly a campaign and return its results when the last vehicle is down.

    campaign: a loaded one, or a file. out: the folder beneath which the results go:
    OUT/<campaign>/<UTC start>. runs: only these, as "case/mode/repetition"; None for all. clock,
    jobs, resume, arm, arm_real, arm_actors, junit: as the options of `wil-campaign run`, but no
    person is asked before an attached vehicle is armed. engine: as of --engine; on a bench of a
    cluster, for which the campaign is given as a file, consent to arm is given on the bench's own
    terminal. store: as of --store, for results of a cluster where no folder is shared.
    bench_files: as of `load`, where the campaign is given as a file. on_result: called with the
    result of each run as it ends; on_message: with sentences for people.

    Ctrl-C lands all vehicles, then raises KeyboardInterrupt; so does an exception of on_result or
    on_message, which is then raised. Raises BadInput for faults of files, CannotFlyError.
    """
    loaded = _loaded(campaign, engine, bench_files)
    request = _request(
        loaded,
        engine=engine,
        store=store,
        out=out,
        runs=runs,
        clock=clock,
        jobs=jobs,
        resume=resume,
        arm=arm,
        arm_real=arm_real,
        arm_actors=arm_actors,
        junit=junit,
    )
    with FlightProcess(request) as process:
        return process.wait(on_result or _ignore, on_message or _ignore)


async def run_async(
    campaign: Campaign | str | Path,
    *,
    out: str | Path = "results",
    runs: Collection[str] | None = None,
    clock: Clock | None = None,
    jobs: int | None = None,
    resume: bool = False,
    arm: bool = True,
    arm_real: bool = False,
    arm_actors: bool = False,
    junit: str | Path | None = None,
    engine: str = LOCAL,
    store: str = "",
    bench_files: Sequence[str | Path] = (),
    on_result: OnResult | None = None,
    on_message: OnMessage | None = None,
) -> CampaignResults:
    """Fly a campaign as `run` does, while the event loop continues.

    on_result and on_message are called in the loop, which handles what they raise. A cancelled call
    lands all vehicles first, and raises CancelledError when they are down.
    """
    loop = asyncio.get_running_loop()
    loaded = await asyncio.to_thread(_loaded, campaign, engine, bench_files)
    request = _request(
        loaded,
        engine=engine,
        store=store,
        out=out,
        runs=runs,
        clock=clock,
        jobs=jobs,
        resume=resume,
        arm=arm,
        arm_real=arm_real,
        arm_actors=arm_actors,
        junit=junit,
    )
    process = FlightProcess(request)
    waiting = loop.run_in_executor(
        None,
        _wait_for,
        process,
        _call_in_loop(loop, on_result or _ignore),
        _call_in_loop(loop, on_message or _ignore),
    )
    return await _await_landing(waiting, process)


def _call_in_loop(
    loop: asyncio.AbstractEventLoop, call: Callable[[T], object]
) -> Callable[[T], object]:
    """Return a function that makes a call in an event loop, from another thread."""
    return lambda value: loop.call_soon_threadsafe(partial(call, value))


async def _await_landing(waiting: "asyncio.Future[T]", process: "FlightProcess") -> T:
    """Await a flight; at each cancellation, land it and continue to wait."""
    cancelled: asyncio.CancelledError | None = None
    while not waiting.done():
        try:
            await asyncio.wait([waiting])
        except asyncio.CancelledError as error:
            cancelled = error
            process.stop()
    if cancelled is not None:
        raise cancelled
    return waiting.result()


def _wait_for(
    process: "FlightProcess", on_result: OnResult, on_message: OnMessage
) -> CampaignResults:
    with process:
        return process.wait(on_result, on_message)


class FlightProcess:
    """A process that flies one campaign; leaving the context lands what still flies."""

    def __init__(self, request: FlightRequest) -> None:
        # Its own session: Ctrl-C reaches only the program, which then requests the landing once.
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "orchestrator.api.flight_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        self._is_stopped = False
        self._send(encode_line(request))

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

    def wait(self, on_result: OnResult, on_message: OnMessage) -> CampaignResults:
        """Return the campaign's results when it is over. Raises CannotFlyError."""
        for message in iter(self._read, None):
            match message:
                case CampaignEnded(folder=folder, exit_code=code):
                    return read_results(folder, exit_code=code)
                case CampaignRefused(text=text, exit_code=code):
                    raise CannotFlyError(text, code)
                case RunFinished(result=result):
                    on_result(result)
                case Message(text=text):
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
            except BrokenPipeError:
                pass  # the process has ended: reading its messages tells how

    def _read(self) -> FlightMessage | None:
        """Return the next message; None at the end."""
        stream = self._process.stdout
        line = b"" if stream is None else stream.readline()
        return decode_message(line) if line else None


def _loaded(
    campaign: Campaign | str | Path, engine: str, bench_files: Sequence[str | Path]
) -> Campaign | Path:
    """Return the loaded campaign; its path if it first has to reserve a bench of a cluster.

    Raises BadInput, ValueError.
    """
    if isinstance(campaign, Campaign):
        if bench_files:
            raise ValueError("bench_files: the campaign is loaded; give them to load()")
        return campaign
    path = Path(campaign)
    if engine != LOCAL and not bench_files and requested_bench(path, Options()) is not None:
        return path
    return load(path, bench_files=bench_files)


def _ignore(_: object) -> None:
    """Ignore an event."""


def _request(
    campaign: Campaign | Path,
    *,
    engine: str,
    store: str,
    out: str | Path,
    runs: Collection[str] | None,
    clock: Clock | None,
    jobs: int | None,
    resume: bool,
    arm: bool,
    arm_real: bool,
    arm_actors: bool,
    junit: str | Path | None,
) -> FlightRequest:
    """Return the request to fly a campaign. Raises CannotFlyError for an unknown run."""
    options = Options()
    if isinstance(campaign, Campaign):
        options = campaign.options
        known = {plan.name for plan in campaign.plans}
        if runs is not None and (unknown := [name for name in runs if name not in known]):
            raise CannotFlyError(f"the campaign has no run '{unknown[0]}'", 2)
    return FlightRequest(
        file=str(campaign if isinstance(campaign, Path) else campaign.document.path),
        cases=options.cases,
        modes=options.modes,
        repetitions=options.repetitions,
        seed=options.seed,
        sets=options.sets,
        runs=None if runs is None else tuple(runs),
        out=str(out),
        clock=clock,
        jobs=jobs,
        junit=None if junit is None else str(junit),
        resume=resume,
        arm=arm,
        arm_real=arm_real,
        arm_actors=arm_actors,
        engine=engine,
        store=store,
        bench_files=tuple(str(bench.document.path) for bench in options.benches),
    )
