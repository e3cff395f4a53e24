"""Flies the search of a campaign file for a Python program: blocking, or awaited."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.foundation.files.limited_json import read_limited_json
from wil_campaign.orchestrator.campaign.flight_options import USUAL
from wil_campaign.orchestrator.cli.run_selection import RunSelection
from wil_campaign.plugins.python.flight_messages import FlightRequest, encode_request
from wil_campaign.plugins.python.flying import (
    FlightProcess,
    OnMessage,
    OnResult,
    await_flight_landing,
    call_in_loop,
    flight_options_with,
)
from wil_campaign.plugins.python.loading import set_option_texts
from wil_campaign.plugins.python.several import as_several
from wil_campaign.plugins.search.exploration.search_file import load_search
from wil_campaign.plugins.search.search_document import FILE_NAME

_MODULE = "wil_campaign.plugins.search.search_process"


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchResults:
    """The results of a search. folder: where its files are; document: search.json.

    exit_code: of `wil-campaign search`: 1 where a failure is confirmed.
    """

    folder: Path
    document: Mapping[str, Any]
    exit_code: int

    @property
    def failures(self) -> tuple[Mapping[str, Any], ...]:
        """Return the variants that failed and were flown again, as of search.json."""
        return tuple(self.document["failures"])

    @property
    def files(self) -> tuple[Path, ...]:
        """Return the campaign files of the confirmed failures, which `run` flies."""
        return tuple(self.folder / failure["file"] for failure in self.failures if failure["file"])


def search(
    file: str | Path,
    *,
    out: str | Path = "results",
    seed: int | None = None,
    overrides: Mapping[str, object] | None = None,
    clock: Clock | None = None,
    jobs: int | None = None,
    resume: bool = False,
    engine: str = USUAL.engine,
    store: str = "",
    bench_files: Sequence[str | Path] = (),
    on_result: OnResult | None = None,
    on_message: OnMessage | None = None,
) -> SearchResults:
    """Fly the search of a campaign file; return what it found when the last vehicle is down.

    out, clock, jobs, resume, engine, store: as of FlightOptions; seed, overrides, bench_files: as
    of `load`; on_result, on_message: as of `run`, as are Ctrl-C and exceptions. Raises BadInput,
    ValueError for an option, CannotFlyError.
    """
    options: dict[str, object] = {"out": out, "clock": clock, "jobs": jobs, "resume": resume}
    options |= {"engine": engine, "store": store}
    request = _request(file, seed, overrides, bench_files, options)
    with FlightProcess(request, _MODULE) as process:
        return _results_of(process, on_result or _ignore, on_message or _ignore)


async def search_async(
    file: str | Path,
    *,
    out: str | Path = "results",
    seed: int | None = None,
    overrides: Mapping[str, object] | None = None,
    clock: Clock | None = None,
    jobs: int | None = None,
    resume: bool = False,
    engine: str = USUAL.engine,
    store: str = "",
    bench_files: Sequence[str | Path] = (),
    on_result: OnResult | None = None,
    on_message: OnMessage | None = None,
) -> SearchResults:
    """Fly a search as `search` does, while the event loop continues.

    on_result and on_message are called in the loop. A cancelled call lands all vehicles first.
    """
    options: dict[str, object] = {"out": out, "clock": clock, "jobs": jobs, "resume": resume}
    options |= {"engine": engine, "store": store}
    request = await asyncio.to_thread(_request, file, seed, overrides, bench_files, options)
    on_result, on_message = call_in_loop(on_result or _ignore), call_in_loop(on_message or _ignore)
    return await await_flight_landing(
        FlightProcess(request, _MODULE), _results_of, on_result, on_message
    )


def _request(
    file: str | Path,
    seed: int | None,
    overrides: Mapping[str, object] | None,
    bench_files: Sequence[str | Path],
    options: Mapping[str, object],
) -> bytes:
    chosen = flight_options_with(USUAL, options)
    benches = tuple(map(Path, as_several(bench_files)))
    choice = RunSelection(seed=seed, set_=set_option_texts(overrides), bench_file=benches)
    load_search(Path(file), choice.options())  # raises BadInput here, before a process starts
    return encode_request(FlightRequest(file=Path(file), choice=choice, options=chosen))


def _results_of(
    process: FlightProcess, on_result: Callable[..., object], on_message: OnMessage
) -> SearchResults:
    """Return the results of a search when it is over."""
    ended = process.wait(on_result, on_message)
    folder = Path(ended.folder)
    document = read_limited_json(folder / FILE_NAME)
    return SearchResults(folder=folder, document=document, exit_code=ended.exit_code)


def _ignore(_: object) -> None:
    """Ignore an event."""
