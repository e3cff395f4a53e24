"""Mixing without a flight for Python programs, and for the commands `mix` and `replay`."""

import math
from pathlib import Path

import cv2
import numpy as np

from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.file_mixing import (
    CombinationReport,
    MixOrder,
    SideFiles,
    mix_files,
)
from wil_campaign.plugins.offline.mixture_outputs import (
    VideoOutput,
    is_run_folder,
    write_mixture_image,
)
from wil_campaign.plugins.offline.offline_pairing import MixedPair
from wil_campaign.plugins.offline.recorded_inputs import recording_file
from wil_campaign.plugins.offline.replay import ReplayReport
from wil_campaign.plugins.offline.replay import replay_mixing as replay_recording
from wil_campaign.recipes.language.recipe_files import load_recipe_file
from wil_campaign.vehicles.readings import BgrImage, CameraReading
from wil_campaign.worlds.camera import LEAST_FOV_DEG
from wil_campaign.worlds.frames import Pose

_VIDEO_HZ = 30.0


def mix(
    recipe: str | Path,
    *,
    real: str | Path,
    twin: str | Path,
    out: str | Path,
    sensor: str | None = None,
    real_fov_deg: float = 69.0,
    twin_fov_deg: float = 69.0,
    real_depth: str | Path | None = None,
    twin_depth: str | Path | None = None,
    place: tuple[float, ...] | None = None,
    stages: str | Path | None = None,
    frame: int = 0,
) -> tuple[CombinationReport, ...]:
    """Mix images, videos or recordings by a recipe, write the mixture, report each combination.

    real, twin: an image, a video, an .mcap or a run's folder; the twin also a world file, drawn
    from `place`: north, east, up in metres, then yaw and pitch in degrees, as far as given. out: an
    image, a video (.mp4) or a recording (.mcap). sensor: of the recipe; None: its first camera, or
    all of a recording. fov_deg: horizontal, where a file does not have it. depth: distances of an
    image, .npy in metres or 16 bit in millimetres. stages: an image of each step of mixture number
    `frame`.

    Raises OfflineError for inputs and outputs, BadInput, StepError of a step, OSError.
    """
    order = MixOrder(
        recipe=load_recipe_file(Path(recipe)),
        real=_side("--real-fov-deg", real, real_fov_deg, real_depth),
        twin=_side("--twin-fov-deg", twin, twin_fov_deg, twin_depth),
        out=Path(out),
        sensor=sensor,
        place=None if place is None else _place(place),
        stages=None if stages is None else Path(stages),
        frame=frame,
    )
    return mix_files(order)


def replay(
    run: str | Path,
    *,
    recipe: str | Path | None = None,
    trust: bool = False,
    out: str | Path | None = None,
) -> ReplayReport:
    """Mix a recorded run again, and report where the result differs from the recording.

    run: its folder, or its run.mcap. recipe: another one than that of the run. trust: whether the
    code that the recording names may run. out: a folder for mixed.mp4, and for worst-NAME.png: the
    recorded image that differs most, the new one, and their difference.

    Raises OfflineError, BadInput, StepError of a step, OSError.
    """
    run = Path(run)
    other = None if recipe is None else load_recipe_file(Path(recipe))
    if out is None:
        return replay_recording(run, other, trusted=trust)
    folder = Path(out)
    _refuse_folder_of_run(folder, run)
    folder.mkdir(parents=True, exist_ok=True)
    with _ReplayVideo(folder / "mixed.mp4") as video:
        report = replay_recording(run, other, trusted=trust, on_mixture=video.receive)
    _write_worst(report, folder)
    return report


def _side(option: str, file: str | Path, fov_deg: float, depth: str | Path | None) -> SideFiles:
    """Return one side's input files of `mix`. Raises OfflineError."""
    if not LEAST_FOV_DEG <= fov_deg < 180.0:
        message = f"must be an angle from {LEAST_FOV_DEG:g} to below 180 degrees"
        raise OfflineError(f"{option} {fov_deg:g}: {message}")
    return SideFiles(file=Path(file), fov_deg=fov_deg, depth=None if depth is None else Path(depth))


def _place(numbers: tuple[float, ...]) -> Pose:
    """Return the camera pose of a world input of `mix`. Raises OfflineError."""
    if not 3 <= len(numbers) <= 5 or not all(math.isfinite(number) for number in numbers):
        given = ",".join(f"{number:g}" for number in numbers)
        raise OfflineError(f"--place {given}: give NORTH,EAST,UP[,YAW[,PITCH]], as 0,0,1.5,90")
    north_m, east_m, up_m, yaw_deg, pitch_deg = (*numbers, 0.0, 0.0)[:5]
    return Pose.of(
        north_m,
        east_m,
        up_m,
        yaw_rad=math.radians(yaw_deg),
        pitch_rad=math.radians(pitch_deg),
    )


def _refuse_folder_of_run(folder: Path, run: Path) -> None:
    """Raise OfflineError for an output folder whose video would replace that of a flight."""
    own = recording_file(run).parent
    if folder.resolve() == own.resolve() or is_run_folder(folder):
        raise OfflineError(f"--out {folder}: is the folder of a recorded run; name another folder")


class _ReplayVideo(VideoOutput):
    """The video that `replay` writes: of the first combination with images."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, rate_hz=_VIDEO_HZ)
        self._name: str | None = None

    def receive(self, name: str, pair: MixedPair) -> None:
        """Append a replayed image to the video, unless it is of another combination."""
        if isinstance(pair.mixed.reading, CameraReading):
            self._name = self._name or name
            if name == self._name:
                super().receive(name, pair)


def _write_worst(report: ReplayReport, folder: Path) -> None:
    """Write the images of replay's worst divergences."""
    for combination in report.combinations:
        if combination.worst is None:
            continue
        _, recorded, again = combination.worst
        if isinstance(recorded, CameraReading) and isinstance(again, CameraReading):
            write_mixture_image(
                folder / f"worst-{combination.name}.png", _side_by_side(recorded, again)
            )


def _side_by_side(recorded: CameraReading, again: CameraReading) -> BgrImage:
    """Return a recorded and a replayed image side by side, with their difference."""
    if recorded.image_bgr.shape != again.image_bgr.shape:
        return again.image_bgr
    apart = cv2.absdiff(recorded.image_bgr, again.image_bgr)
    return np.hstack([recorded.image_bgr, again.image_bgr, apart]).astype(np.uint8)
