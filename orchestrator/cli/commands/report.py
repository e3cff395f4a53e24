"""`wil-campaign report`: writes the HTML report of a flown campaign."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.orchestrator.cli.standard_streams import err, out
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.results_folder import read_campaign
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.run_video import make_video
from wil_campaign.orchestrator.report.campaign_report import write_report
from wil_campaign.orchestrator.report.run_graphics import write_card, write_moving_picture
from wil_campaign.worlds.files.problems import printable

_SHOWN = 10
_ALL = "all"


def report(
    folder: Path,
    *,
    out_: Annotated[Path | None, Parameter(name="--out")] = None,
    video: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    card: Annotated[bool, Parameter(negative=())] = False,
    gif: Annotated[bool, Parameter(negative=())] = False,
    run: str = "",
) -> int:
    """Write the report of a campaign: one HTML page that needs no network and no other file.

    Missing or damaged parts are left out and named: then the exit code is 3, and 2 where the folder
    has no campaign, or no run of a name.

    Parameters
    ----------
    folder
        The results folder of a campaign: DIR/<campaign>/<UTC start>. It may be unfinished.
    out_
        The file to write; by default report.html in the folder, where links to videos lead.
    video
        A run whose mixed.mp4 is made of its recorded images first, as large/wil/1; `all` for every
        run. May be given several times.
    card
        Write card.png into the folder of a run too: its moment as one picture to share, with the
        real, twin and mixed image, the plan, and the verdict.
    gif
        Write flight.gif into the folder of a run too: its flight as a moving picture.
    run
        The run of --card and --gif, as large/wil/1; by default the failed run that decides, else a
        failed one, else the first of mode wil.
    """
    try:
        without = _make_videos(folder, video)
        graphics = _write_graphics(folder, run, card=card, gif=gif)
        written = write_report(folder, out=out_)
    except ResultsFolderError as error:
        err(printable(str(error)))
        return 2
    except OSError as error:
        err(f"the report cannot be written: {error.strerror or error}")
        return 3
    problems = (*without, *written.problems)
    _name_problems(problems)
    for path in graphics:
        out(printable(f"picture: {path}"))
    out(printable(f"report: {written.path}"))
    return 3 if problems else 0


def _write_graphics(folder: Path, run: str, *, card: bool, gif: bool) -> list[Path]:
    """Write the pictures to share; return their paths.

    Raises ResultsFolderError for an unknown run, or one that has nothing to show; OSError.
    """
    if run and not (card or gif):
        raise ResultsFolderError(f"--run {run} needs --card or --gif")
    written = [write_card(folder, run)] if card else []
    return [*written, write_moving_picture(folder, run)] if gif else written


def _make_videos(folder: Path, wanted: Sequence[str]) -> list[str]:
    """Make the videos of runs; return for which there is none, and why.

    Raises ResultsFolderError where a run is not there.
    """
    if not wanted:
        return []
    names = [entry.name for entry in read_campaign(folder).entries]
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


def _name_problems(problems: Sequence[str]) -> None:
    for text in problems[:_SHOWN]:
        err(printable(text))
    more = len(problems) - _SHOWN
    if more > 0:
        err(f"and {more} more, which the report names")
