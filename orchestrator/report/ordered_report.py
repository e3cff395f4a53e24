"""Writes a report with what was ordered beside it: videos of runs, and pictures to share."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.hooks import report_images
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.run_video import make_video
from wil_campaign.orchestrator.report.campaign_report import write_report

_SHOWN = 10
_ALL = "all"


@dataclass(frozen=True, slots=True)
class Report:
    """A written report: its path. problems: in words, what it lacks, as it is missing or damaged.

    pictures: the paths of those that were ordered.
    """

    path: Path
    problems: tuple[str, ...]
    pictures: tuple[Path, ...] = ()


def write_ordered_report(
    folder: str | Path,
    *,
    out: str | Path | None = None,
    videos: Sequence[str] = (),
    pictures: Sequence[str] = (),
    run: str = "",
    workers: int | None = 1,
) -> Report:
    """Write the report of a campaign's results folder: one HTML page that needs no other file.

    out: the file; None: report.html in the folder. videos: runs whose mixed.mp4 is made of their
    recorded images first, as "large/wil/1", or "all". pictures: names of ReportImages, to be
    written into the folder of `run`; "" for the one to show first. workers: processes that read the
    runs; None: one per core, for which the main module must be importable.

    Raises ResultsFolderError for a folder without a campaign, an unknown run, or one that has
    nothing to show; OSError.
    """
    folder = Path(folder)
    without = _make_videos(folder, videos)
    shown = _draw_images(folder, pictures, run, without)
    written = write_report(folder, out=None if out is None else Path(out), workers=workers)
    return Report(written.path, (*without, *written.problems), shown)


def _draw_images(
    folder: Path, wanted: Sequence[str], run: str, without: list[str]
) -> tuple[Path, ...]:
    """Write pictures of a run; return their paths. Raises ResultsFolderError, OSError.

    without: gets which cannot be drawn of the recording, and why: the report is written all the
    same.
    """
    known, missing = plugin_additions(report_images), absent_additions(report_images)
    if run and not wanted:
        options = " or ".join(f"--{name}" for name in (*known, *missing))
        raise ResultsFolderError(f"--run {run} needs {options}")
    for name in wanted:
        if name in missing:
            raise ResultsFolderError(missing[name])
    shown: list[Path] = []
    for name in wanted:
        try:
            shown.append(load_plugin_object(known[name].write)(folder, run))
        except RecordingError as error:
            without.append(f"no --{name}: {error}")
    return tuple(shown)


def _make_videos(folder: Path, wanted: Sequence[str]) -> list[str]:
    """Make the videos of runs; return for which there is none, and why.

    Raises ResultsFolderError where a run is not there.
    """
    if not wanted:
        return []
    names = [entry.name for entry in read_campaign_documents(folder).entries]
    if unknown := sorted({*wanted} - {*names, _ALL}):
        raise ResultsFolderError(
            f"--video {unknown[0]}: no run of {folder}; there are {', '.join(names[:_SHOWN])}"
            + (" and others" if len(names) > _SHOWN else "")
        )
    without = []
    for name in names if _ALL in wanted else dict.fromkeys(wanted):
        try:
            if not make_video(folder / name) and name in wanted:
                without.append(f"{name}: no video, because no images of it are recorded")
        except (RecordingError, OSError) as error:
            without.append(f"{name}: no video: {error}")
    return without
