"""`wil-campaign replay`: mix a recorded run again, and report where the result diverges."""

import json
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from cyclopts import Parameter

from wil_campaign.orchestrator.cli.standard_streams import err, out
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.mixture_outputs import VideoOut, is_run_folder, write_image
from wil_campaign.plugins.offline.offline_pairing import MixedPair
from wil_campaign.plugins.offline.recorded_inputs import recording_file
from wil_campaign.plugins.offline.replay import Replayed, ReplayReport, replay
from wil_campaign.recipes.language.recipe_files import load_recipe_file
from wil_campaign.recipes.working import StepError
from wil_campaign.vehicles.readings import BgrImage, CameraReading

_VIDEO_HZ = 30.0
_SHOWN = 5


def replay_run(
    run: Path,
    *,
    recipe: Path | None = None,
    trust: Annotated[bool, Parameter(negative=())] = False,
    out_: Annotated[Path | None, Parameter(name="--out")] = None,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Mix a recorded run again, and report where the result diverges from the recording.

    Exits with 0 when it does not diverge, with 1 when it does, and with 3 when the recording has no
    mixture to compare.

    Parameters
    ----------
    run
        A run's folder, or its run.mcap.
    recipe
        Another recipe; by default that of the run.
    trust
        Run the user's own steps that the recording names; without it a recording that names code
        is refused. Steps of a --recipe run in any case.
    out_
        A folder for the mixture as a video, and for the worst divergence as an image: the recorded
        image, the new one, and their difference.
    json_
        Print one JSON document.
    """
    try:
        other = None if recipe is None else load_recipe_file(recipe)
        if out_ is None:
            report = replay(run, other, trusted=trust)
        else:
            _refuse_folder_of_run(out_, run)
            out_.mkdir(parents=True, exist_ok=True)
            with _ReplayVideo(out_ / "mixed.mp4") as video:
                report = replay(run, other, trusted=trust, on_mixture=video.take)
            _write_worst(report, out_)
    except OfflineError as error:
        err(error)
        return 2
    except (StepError, OSError) as error:
        err(error)
        return 3
    out(_as_json(report) if json_ else _as_text(report))
    if out_ is not None and not json_:
        out(f"written: {out_}")
    if report.diverges:
        return 1
    return 0 if report.compared else 3


def _refuse_folder_of_run(folder: Path, run: Path) -> None:
    """Raise OfflineError for an output folder whose video would replace that of a flight."""
    own = recording_file(run).parent
    if folder.resolve() == own.resolve() or is_run_folder(folder):
        raise OfflineError(f"--out {folder}: is the folder of a recorded run; name another folder")


class _ReplayVideo(VideoOut):
    """The video that `replay` writes: of the first combination with images."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, rate_hz=_VIDEO_HZ)
        self._name: str | None = None

    def take(self, name: str, pair: MixedPair) -> None:
        """Append a replayed image to the video, unless it is of another combination."""
        if isinstance(pair.mixed.reading, CameraReading):
            self._name = self._name or name
            if name == self._name:
                super().take(name, pair)


def _write_worst(report: ReplayReport, folder: Path) -> None:
    """Write the images of replay's worst divergences."""
    for one in report.combinations:
        if one.worst is None:
            continue
        _, recorded, again = one.worst
        if isinstance(recorded, CameraReading) and isinstance(again, CameraReading):
            write_image(folder / f"worst-{one.name}.png", _side_by_side(recorded, again))


def _side_by_side(recorded: CameraReading, again: CameraReading) -> BgrImage:
    """Return a recorded and a replayed image side by side, with their difference."""
    if recorded.image_bgr.shape != again.image_bgr.shape:
        return again.image_bgr
    apart = cv2.absdiff(recorded.image_bgr, again.image_bgr)
    return np.hstack([recorded.image_bgr, again.image_bgr, apart]).astype(np.uint8)


def _as_text(report: ReplayReport) -> str:
    """Return the replay's report as text."""
    lines = [line for one in report.combinations for line in _lines(one)]
    lines += [f"{name}: recorded, but not made by the recipe" for name in report.without]
    if report.lacks:
        lines.append(report.lacks)
    return "\n".join(lines)


def _lines(one: Replayed) -> list[str]:
    """Return the report lines of one replayed combination."""
    how = "to the bit" if one.exact else "within the loss of JPEG"
    left_out = ", ".join(f"{what} {count}" for what, count in one.dropped.items())
    mixed = f"{one.name}: {one.mixed} of {one.frames} mixed"
    mixed += f" ({left_out})" if left_out else ""
    if not one.compared:
        return [f"{mixed}; the recording has no mixture to compare"]
    if not one.divergences:
        return [f"{mixed}; all as recorded, {how}"]
    lines = [f"{mixed}; {len(one.divergences)} of {one.compared} differ from the recording"]
    for found in one.divergences[:_SHOWN]:
        at = "" if found.t_s is None else f" at {found.t_s:.3f} s"
        lines.append(f"  frame {found.frame}{at}: {found.difference.what}")
    if len(one.divergences) > _SHOWN:
        lines.append(f"  and {len(one.divergences) - _SHOWN} more")
    return lines


def _as_json(report: ReplayReport) -> str:
    """Return the replay's report as JSON."""
    document = {
        "diverges": report.diverges,
        "lacks": report.lacks,
        "without": list(report.without),
        "combinations": [
            {
                "name": one.name,
                "frames": one.frames,
                "mixed": one.mixed,
                "dropped": dict(one.dropped),
                "compared": one.compared,
                "exact": one.exact,
                "divergences": [
                    {"frame": found.frame, "t_s": found.t_s, "what": found.difference.what}
                    for found in one.divergences
                ],
            }
            for one in report.combinations
        ],
    }
    return json.dumps(document, indent=2, ensure_ascii=False)
