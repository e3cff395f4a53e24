"""Writes report.html of a results folder; reads the runs in parallel where there are many."""

import base64
import multiprocessing
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from wil_campaign import hooks
from wil_campaign.foundation.files.document_writer import write_atomically
from wil_campaign.foundation.processes.linux import usable_cores
from wil_campaign.foundation.processes.parallel_calls import Call, call_in_processes
from wil_campaign.hooks import ReportSection, RunSection, Section
from wil_campaign.installed_plugins import load_plugin_object, needed_plugin_text, plugin_additions
from wil_campaign.orchestrator.campaign.workers.run_server import running_context
from wil_campaign.orchestrator.reading.model import CampaignDocuments, RunEntry
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.recording.timestamps import utc_text
from wil_campaign.orchestrator.report.model import RunReport
from wil_campaign.orchestrator.report.reading.run_reader import read_run
from wil_campaign.orchestrator.report.reading.sight_decoding import ImageSize
from wil_campaign.orchestrator.report.rendering.overview import stand_in_notice
from wil_campaign.orchestrator.report.rendering.page import (
    RunPage,
    decides_verdict,
    page_anchors,
    render_page,
    render_run,
    went_wrong,
)

FILE_NAME = "report.html"
_ALONE, _ALONE_BESIDE_SERVER = 8, 2
"""Up to this many runs one process is as fast as several: spawned ones, those of a run server."""
_FEW = 12
"""Up to this many failed runs have large frames: 7 per run, some 30 kB a frame."""
_VIDEO_BYTES = 1_000_000
"""Limit on the videos embedded in the page, in total: those of runs that did not pass."""


@dataclass(frozen=True, slots=True)
class WrittenReport:
    """The path of the report. problems: what is missing or damaged, so that the report lacks it.

    texts: what its sections say at the end of `run`.
    """

    path: Path
    problems: tuple[str, ...]
    texts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Order:
    """One run to render; picklable. embeds: whether its video is embedded in the page.

    stand_in: a text that no hardware flew as `real`; empty where it did.
    """

    folder: Path
    entry: RunEntry
    anchor: str
    size: ImageSize
    embeds: bool
    stand_in: str = ""


def write_report(
    folder: Path, *, out: Path | None = None, workers: int | None = None
) -> WrittenReport:
    """Write the report of a results folder. out: the file; None: report.html in the folder.

    workers: the largest number of processes that read the runs; None: one per core.

    What is unreadable is left out, and listed in the page and in the returned problems. Raises
    ResultsFolderError without a campaign in the folder; OSError when the page cannot be written.
    """
    campaign = read_campaign_documents(folder)
    size = ImageSize.for_runs(len(campaign.entries))
    names = page_anchors(entry.name for entry in campaign.entries)
    embedded = set(_runs_with_video(folder, campaign.entries))
    bad = {entry.name for entry in campaign.entries if went_wrong(entry.result)}
    large = bad if len(bad) <= _FEW else set()
    orders = [
        _Order(
            folder,
            entry,
            anchor,
            size.for_failure() if entry.name in large else size,
            entry.name in embedded,
            stand_in_notice(campaign),
        )
        for entry, anchor in zip(campaign.entries, names, strict=True)
    ]
    pages, sections = _pages_and_sections(orders, folder, campaign, workers)
    path = folder / FILE_NAME if out is None else out
    html = [section.html for section in sections]
    write_atomically(path, render_page(campaign, html, pages, made_utc=utc_text(time.time())))
    problems = [f"{page.name}: {text}" for page in pages for text in page.problems]
    if out is None:
        for name, text in (file for section in sections for file in section.files.items()):
            try:
                write_atomically(folder / name, text)
            except OSError as error:
                problems.append(f"{name} cannot be written: {error.strerror or error}")
    problems += [text for section in sections for text in section.problems]
    texts = tuple(section.text for section in sections if section.text)
    return WrittenReport(path, (*campaign.problems, *problems), texts)


def _runs_with_video(folder: Path, entries: Iterable[RunEntry]) -> Iterator[str]:
    """Yield the failed runs whose videos fit into the page; runs that decide come first."""
    room = _VIDEO_BYTES
    for entry in sorted(entries, key=lambda one: not decides_verdict(one.result)):
        with suppress(OSError):
            if went_wrong(entry.result):
                size_bytes = (folder / entry.name / "mixed.mp4").stat().st_size
                if size_bytes <= room:
                    room -= size_bytes
                    yield entry.name


def _pages_and_sections(
    orders: Sequence[_Order], folder: Path, documents: CampaignDocuments, most: int | None
) -> tuple[list[RunPage], list[Section]]:
    """Return the runs of the page, and what plugins add to it."""
    wanted = tuple(plugin_additions(hooks.report_sections).values())
    workers, server = min(most or usable_cores(), len(orders)), running_context()
    if len(orders) > (_ALONE if server is None else _ALONE_BESIDE_SERVER) and workers > 1:
        # Spawned, not forked from here: earlier flights may have left threads.
        context = server or multiprocessing.get_context("spawn")
        calls: list[Call[Any]] = [
            *((_section, (each, folder, documents)) for each in wanted),
            *((_page, (order,)) for order in orders),
        ]
        # Workers also fail if the main module cannot be imported again.
        with suppress(BrokenProcessPool, OSError):
            found = call_in_processes(calls, workers, context)
            return found[len(wanted) :], found[: len(wanted)]
    return list(map(_page, orders)), [
        _section(report_section, folder, documents) for report_section in wanted
    ]


def _section(
    wanted: ReportSection | RunSection, folder: Path, what: CampaignDocuments | RunReport
) -> Section:
    """Return what a plugin adds about a campaign or about a run."""
    try:
        found: Section = load_plugin_object(wanted.section)(folder, what)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - a plugin may raise anything
        text = needed_plugin_text("it", error) or f"{type(error).__name__}: {error}"
        why = f"the section {wanted.name} is left out: {text}"
        return Section(problems=(why,))
    return found


def _page(order: _Order) -> RunPage:
    try:
        return _read_and_render(order)
    except Exception as error:  # noqa: BLE001 - a damaged file may raise anything
        entry = order.entry
        why = f"the run cannot be shown: {type(error).__name__}: {error}"
        run = RunReport(
            name=entry.name,
            case=entry.case,
            mode=entry.mode,
            rep=entry.rep,
            result=entry.result,
            problems=(*entry.problems, why),
        )
        return render_run(run, anchor=order.anchor, stand_in=order.stand_in)


def _read_and_render(order: _Order) -> RunPage:
    run = read_run(order.folder, order.entry, order.size)
    video = None
    if order.embeds and run.video is not None:
        with suppress(OSError):
            data = (order.folder / run.name / run.video).read_bytes()
            video = f"data:video/mp4;base64,{base64.b64encode(data).decode('ascii')}"
    wanted = plugin_additions(hooks.run_sections).values()
    sections = [_section(run_section, order.folder, run) for run_section in wanted]
    run = replace(run, problems=(*run.problems, *(text for s in sections for text in s.problems)))
    return render_run(
        run,
        anchor=order.anchor,
        video=video,
        stand_in=order.stand_in,
        sections=[section.html for section in sections],
    )
