"""Searches recorded images for a calibration board."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.foundation.files.paths import is_file, is_folder, path_exists
from wil_campaign.plugins.calibration.boards import Board, BoardSighting, CalibrationError, Picture
from wil_campaign.plugins.cameras.image_files import ImageFolder, VideoFile
from wil_campaign.plugins.cameras.mcap_images import McapFile
from wil_campaign.plugins.cameras.recorded_camera import ImageFile
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.image_inputs import still_images
from wil_campaign.plugins.offline.recorded_inputs import recording_file, recording_items
from wil_campaign.plugins.python.mcap_reader import RecordedReading
from wil_campaign.vehicles.readings import CameraReading

STEP_S = 0.1
"""A hand moves little in this time, and searching an image takes tens of milliseconds."""
_IMAGES_HZ = 1.0
"""Images of a folder have no times: at this rate each of them is searched."""
RUN_FILE = "run.mcap"

TimedImage = tuple[float, Picture]


@dataclass(frozen=True, slots=True)
class BoardViews:
    """The views of a board. size: of the images, (width, height). searched: number of images."""

    size: tuple[int, int]
    sightings: tuple[BoardSighting, ...]
    searched: int


class BoardSearch:
    """Searches images one by one for the calibration board; all have to be of one size."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._size: tuple[int, int] | None = None
        self._sightings: list[BoardSighting] = []
        self._searched = 0

    def search(self, t_s: float, image_bgr: Picture) -> bool:
        """Search an image for the board; return whether it shows it. Raises CalibrationError."""
        size = (image_bgr.shape[1], image_bgr.shape[0])
        if self._size is None:
            self._size = size
        elif size != self._size:
            raise CalibrationError(
                f"image {self._searched + 1} has {size[0]}x{size[1]}, those before it "
                f"{self._size[0]}x{self._size[1]}: a calibration is for one size"
            )
        self._searched += 1
        sighting = self._board.find(image_bgr, t_s)
        if sighting is not None:
            self._sightings.append(sighting)
        return sighting is not None

    def views(self) -> BoardViews:
        """Return the board's views. Raises CalibrationError if no image shows the board."""
        if self._size is None:
            raise CalibrationError("there is no image to search")
        if not self._sightings:
            raise CalibrationError(
                f"{self._board.name} was found in none of {self._searched} images: count a "
                "chessboard's inner corners, not its squares (of a ChArUco board the squares), "
                "leave a white rim, and take sharp and well lit images"
            )
        return BoardViews(self._size, tuple(self._sightings), self._searched)


def search_board_in_file(path: Path, board: Board, *, sensor: str, vehicle: str) -> BoardViews:
    """Return the board's views in a video, a folder of images, an MCAP file or a recorded run.

    sensor, vehicle: the camera of a recorded run. Raises OfflineError for an unreadable file,
    CalibrationError for one without the board.
    """
    search = BoardSearch(board)
    for t_s, image_bgr in thinned_images(_images_of(path, sensor, vehicle)):
        search.search(t_s, image_bgr)
    return search.views()


def is_recorded_run(path: Path) -> bool:
    """Return whether a path is a recorded run: its folder, or its run.mcap."""
    return path.name == RUN_FILE or is_file(path / RUN_FILE)


def thinned_images(images: Iterable[TimedImage]) -> Iterator[TimedImage]:
    """Yield images that are at least STEP_S apart."""
    due_s = float("-inf")
    for t_s, image_bgr in images:
        if t_s >= due_s:
            due_s = t_s + STEP_S
            yield t_s, image_bgr


def _images_of(path: Path, sensor: str, vehicle: str) -> Iterator[TimedImage]:
    """Yield the images of a file, folder or run."""
    if not path_exists(path):
        raise OfflineError(f"{path}: there is no such file or folder")
    if is_recorded_run(path):
        yield from _images_of_run(path if is_folder(path) else path.parent, sensor, vehicle)
    elif is_folder(path):
        yield from _images_of_file(ImageFolder(path=path, rate_hz=_IMAGES_HZ))
    elif path.suffix == ".mcap":
        yield from _images_of_file(McapFile(path=path))
    else:
        yield from _images_of_file(VideoFile(path=path))


def _images_of_file(file: ImageFile) -> Iterator[TimedImage]:
    return ((still.offset_s, still.image_bgr) for still in still_images(file))


def _images_of_run(folder: Path, sensor: str, vehicle: str) -> Iterator[TimedImage]:
    """Yield a camera's images of a recorded run. Raises OfflineError."""
    cameras: set[str] = set()
    found = False
    for item in recording_items(recording_file(folder)):
        if not isinstance(item, RecordedReading) or not isinstance(item.reading, CameraReading):
            continue
        cameras.add(f"{item.reading.source} {item.sensor}")
        if (item.reading.source, item.sensor) == (vehicle, sensor):
            found = True
            yield item.reading.t_s, item.reading.image_bgr
    if not found:
        present = ", ".join(sorted(cameras)) or "none"
        raise OfflineError(
            f"{folder}: has no images of '{vehicle} {sensor}' (it has: {present}); choose a camera "
            "by --vehicle and --sensor"
        )
