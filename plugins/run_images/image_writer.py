"""Writes the pictures of a run that people share: card.png and flight.gif in its folder."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

from wil_campaign.foundation.files.document_writer import write_atomically
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.model import CampaignDocuments, RunEntry
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.recording.recorded_images import NotDrawnAgainError
from wil_campaign.orchestrator.report.model import RunReport
from wil_campaign.orchestrator.report.reading.run_reader import read_run
from wil_campaign.orchestrator.report.reading.sight_decoding import ImageSize
from wil_campaign.orchestrator.report.rendering.overview import stand_in_notice
from wil_campaign.orchestrator.report.rendering.page import decides_verdict, went_wrong
from wil_campaign.plugins.run_images.card import draw_card
from wil_campaign.plugins.run_images.moving_picture import frame_times, write_gif
from wil_campaign.plugins.run_images.recorded_images import ImagesAtTime, most_mixed, read_images

CARD = "card.png"
GIF = "flight.gif"
_NAMED = 10
_BEFORE_S = (2.0, 1.5, 1.0, 0.5)


def write_card(folder: Path, run: str = "") -> Path:
    """Write the card of a run; return its path. run: its name; empty for the one to show first.

    Raises ResultsFolderError for an unknown run, or one that has no files; NotDrawnAgainError,
    OSError.
    """
    campaign, entry = _find_run(folder, run)
    report = _read(folder, entry)
    images = _images(folder, entry, _card_times(report))
    note = "" if entry.mode == "sim" else stand_in_notice(campaign)
    sheet = draw_card(report, campaign.name, most_mixed(images), note)
    path, picture = folder / entry.name / CARD, BytesIO()
    sheet.image.save(picture, format="PNG")
    write_atomically(path, picture.getvalue())
    return path


def _card_times(run: RunReport) -> list[float]:
    """Return the times of the card's images: the moment; of a pass also shortly before it.

    A vehicle that passed an object does not see it any more when it is nearest.
    """
    if run.moment is None:
        return []
    before_s = _BEFORE_S if run.success is not None else ()
    return [*(run.moment.t_s - one for one in before_s), run.moment.t_s]


def write_moving_picture(folder: Path, run: str = "") -> Path:
    """Write the moving picture of a run; return its path. run: as for the card.

    Raises ResultsFolderError for an unknown run, or one without recorded images;
    NotDrawnAgainError, OSError.
    """
    campaign, entry = _find_run(folder, run)
    report = _read(folder, entry)
    path, picture = folder / entry.name / GIF, BytesIO()
    images = _images(folder, entry, frame_times(report))
    if not images:
        raise ResultsFolderError(f"--gif: no images of {entry.name} are recorded in run.mcap")
    write_gif(picture, report, campaign.name, images)
    write_atomically(path, picture.getvalue())
    return path


def _images(folder: Path, entry: RunEntry, wanted_s: Sequence[float]) -> list[ImagesAtTime]:
    """Return the images of a run at the wanted times. Raises NotDrawnAgainError."""
    try:
        return read_images(folder / entry.name, mode=entry.mode, wanted_s=wanted_s)
    except NotDrawnAgainError as error:
        raise NotDrawnAgainError(f"{entry.name}: {error}") from error


def _read(folder: Path, entry: RunEntry) -> RunReport:
    if not (folder / entry.name).is_dir():
        raise ResultsFolderError(f"{entry.name}: the run was not flown, or its folder is missing")
    return read_run(folder, entry, ImageSize.for_runs(1))


def _find_run(folder: Path, name: str) -> tuple[CampaignDocuments, RunEntry]:
    """Return the run of a name, or the one to show: a failed one that decides, else the first."""
    campaign = read_campaign_documents(folder)
    if name:
        found = next((entry for entry in campaign.entries if entry.name == name), None)
        if found is None:
            names = ", ".join(entry.name for entry in campaign.entries[:_NAMED])
            raise ResultsFolderError(f"--run {name}: no run of {folder}; there are {names}")
        return campaign, found
    if not campaign.entries:
        raise ResultsFolderError(f"{folder} has no runs")
    return campaign, min(campaign.entries, key=_rank)


def _rank(entry: RunEntry) -> tuple[bool, bool, bool]:
    bad = went_wrong(entry.result)
    return (not (bad and decides_verdict(entry.result)), not bad, entry.mode != "wil")
