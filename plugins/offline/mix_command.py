"""`wil-campaign mix`: mix images, videos or recordings by a recipe, without a flight."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.plugins.offline.calls import mix as mix_files
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.file_mixing import CombinationReport
from wil_campaign.recipes.working import StepError


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class InputOptics:
    """The options of `mix` about camera optics, distances and pose.

    Parameters
    ----------
    real_fov_deg
        The horizontal field of view of the real camera, where the file does not state it.
    twin_fov_deg
        The horizontal field of view of the twin's camera.
    real_depth
        Distances of the real image: .npy in metres, or a 16-bit image in millimetres.
    twin_depth
        Distances of the twin's image.
    place
        NORTH,EAST,UP[,YAW[,PITCH]] of the camera in a world file, in metres and degrees.
    """

    real_fov_deg: float = 69.0
    twin_fov_deg: float = 69.0
    real_depth: Path | None = None
    twin_depth: Path | None = None
    place: str | None = None


_USUAL = InputOptics()


def mix(
    recipe: Path,
    *,
    real: Path,
    twin: Path,
    out_: Annotated[Path, Parameter(name="--out")],
    stages: Path | None = None,
    frame: int = 0,
    sensor: str | None = None,
    optics: InputOptics = _USUAL,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Mix images, videos or recordings by a recipe, without a flight.

    Exits with 0 when everything was mixed, and with 3 when something had to be left out.

    Parameters
    ----------
    recipe
        The recipe file, YAML or the paper's XML.
    real
        The real camera's images: an image, a video, an .mcap, or a run's folder.
    twin
        The twin's images: the same kinds, or a world file, which is drawn from --place.
    out_
        Where the mixture goes: an image, a video (.mp4) or a recording (.mcap).
    stages
        Write a contact sheet of each step here, as an image.
    frame
        Which mixture the contact sheet shows, counted from 0.
    sensor
        Which sensor of the recipe; by default its first camera, or all of a recording.
    json_
        Print one JSON document.
    """
    try:
        reports = mix_files(
            recipe,
            real=real,
            twin=twin,
            out=out_,
            sensor=sensor,
            real_fov_deg=optics.real_fov_deg,
            twin_fov_deg=optics.twin_fov_deg,
            real_depth=optics.real_depth,
            twin_depth=optics.twin_depth,
            place=_numbers(optics.place),
            stages=stages,
            frame=frame,
        )
    except OfflineError as error:
        write_stderr(error)
        return 2
    except (StepError, OSError) as error:
        write_stderr(error)
        return 3
    code = _print_reports(reports, json=json_)
    if code == 0 and not json_:
        write_stdout(f"mixture: {out_}")
    return code


def _print_reports(reports: Sequence[CombinationReport], *, json: bool) -> int:
    """Print the reports of `mix`; return its exit code."""
    if json:
        write_stdout(_as_json(reports))
    for report in reports:
        write = write_stdout if report.complete and not json else write_stderr
        if not (json and report.complete):
            write(_as_text(report))
    return 0 if all(report.complete for report in reports) else 3


def _numbers(text: str | None) -> tuple[float, ...] | None:
    """Return the numbers of --place; none for what are no numbers. Raises OfflineError."""
    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise OfflineError(
            f"--place {text}: give NORTH,EAST,UP[,YAW[,PITCH]], as 0,0,1.5,90"
        ) from None


def _as_text(report: CombinationReport) -> str:
    """Return a combination's report of `mix` as text."""
    text = f"{report.name}: {report.mixed} of {report.frames} mixed"
    left_out = {**report.dropped, **report.faults}
    if left_out:
        text += " (" + ", ".join(f"{what} {count}" for what, count in left_out.items()) + ")"
    return "\n  ".join([text, *report.reasons])


def _as_json(reports: Sequence[CombinationReport]) -> str:
    """Return the reports of `mix` as JSON."""
    document = [
        {
            "name": report.name,
            "frames": report.frames,
            "mixed": report.mixed,
            "dropped": dict(report.dropped),
            "faults": dict(report.faults),
            "said": list(report.reasons),
        }
        for report in reports
    ]
    return json.dumps(document, indent=2, ensure_ascii=False)
