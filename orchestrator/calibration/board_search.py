"""Looks for a board in recorded pictures."""

from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from orchestrator.offline.errors import OfflineError
from orchestrator.offline.recorded_inputs import items, recording_file
from orchestrator.recording.mcap_reader import RecordedReading
from vehicles.calibration.boards import Board, CalibrationError, Picture, Sighting
from vehicles.readings import CameraReading
from vehicles.sources.camera_source import SourceError
from vehicles.sources.cameras.image_files import ImageFolder, VideoFile
from vehicles.sources.cameras.mcap_images import McapFile
from vehicles.sources.cameras.recorded_camera import ImageFile
from worlds.files.paths import exists, is_file, is_folder

STEP_S = 0.1
"""A hand moves little in between, and a picture takes tens of milliseconds to be searched."""
_IMAGES_HZ = 1.0
"""Images of a folder have no times: each of them counts."""
RUN_FILE = "run.mcap"

TimedPicture = tuple[float, Picture]


@dataclass(frozen=True, slots=True)
class BoardViews:
    """The calibration board's views in images. size: (width, height). looked: images searched."""

    size: tuple[int, int]
    sightings: tuple[Sighting, ...]
    looked: int


class BoardSearch:
    """Searches images one by one for the calibration board; all have to be of one size."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._size: tuple[int, int] | None = None
        self._found: list[Sighting] = []
        self._looked = 0

    def look(self, t_s: float, image_bgr: Picture) -> bool:
        """Search an image for the board; return whether it shows it. Raises CalibrationError."""
        size = (image_bgr.shape[1], image_bgr.shape[0])
        if self._size is None:
            self._size = size
        elif size != self._size:
            raise CalibrationError(
                f"picture {self._looked + 1} has {size[0]}x{size[1]}, those before it "
                f"{self._size[0]}x{self._size[1]}: a calibration is for one size"
            )
        self._looked += 1
        sighting = self._board.find(image_bgr, t_s)
        if sighting is not None:
            self._found.append(sighting)
        return sighting is not None

    def seen(self) -> BoardViews:
        """Return the board's views. Raises CalibrationError when the board never showed."""
        if self._size is None:
            raise CalibrationError("there is no image to search")
        if not self._found:
            raise CalibrationError(
                f"{self._board.name} was seen in none of {self._looked} pictures: count a "
                "chessboard's inner corners, not its squares (of a ChArUco board the squares), "
                "leave a white rim, and show it sharp and well lit"
            )
        return BoardViews(self._size, tuple(self._found), self._looked)


def search_file(path: Path, board: Board, *, sensor: str, vehicle: str) -> BoardViews:
    """Return the board's views in a video, a folder of images, an MCAP file or a recorded run.

    sensor, vehicle: whose pictures, of a recorded run. Raises OfflineError for a file that cannot
    be read, CalibrationError for one that shows no board.
    """
    looker = BoardSearch(board)
    for t_s, image_bgr in thinned(_images_of(path, sensor, vehicle)):
        looker.look(t_s, image_bgr)
    return looker.seen()


def is_run(path: Path) -> bool:
    """Return whether the path to search is that of a recorded run: its folder, or its run.mcap."""
    return path.name == RUN_FILE or is_file(path / RUN_FILE)


def thinned(pictures: Iterable[TimedPicture]) -> Iterator[TimedPicture]:
    """Yield images to search that are a step apart at least."""
    due_s = float("-inf")
    for t_s, image_bgr in pictures:
        if t_s >= due_s:
            due_s = t_s + STEP_S
            yield t_s, image_bgr


def _images_of(path: Path, sensor: str, vehicle: str) -> Iterator[TimedPicture]:
    """Yield the images of a file, folder or run that are searched for the board."""
    if not exists(path):
        raise OfflineError(f"{path}: there is no such file or folder")
    if is_run(path):
        yield from _of_run(path if is_folder(path) else path.parent, sensor, vehicle)
    elif is_folder(path):
        yield from _of_file(ImageFolder(path=path, rate_hz=_IMAGES_HZ))
    elif path.suffix == ".mcap":
        yield from _of_file(McapFile(path=path))
    else:
        yield from _of_file(VideoFile(path=path))


def _of_file(file: ImageFile) -> Iterator[TimedPicture]:
    """Yield the images of a video or MCAP file to search, with their times."""
    try:
        with closing(file):
            file.open()
            while (still := file.next()) is not None:
                yield still.offset_s, still.image_bgr
    except SourceError as error:
        raise OfflineError(str(error)) from error


def _of_run(folder: Path, sensor: str, vehicle: str) -> Iterator[TimedPicture]:
    """Yield a camera's images of a recorded run to search. Raises OfflineError."""
    there: set[str] = set()
    found = False
    for item in items(recording_file(folder)):
        if not isinstance(item, RecordedReading) or not isinstance(item.reading, CameraReading):
            continue
        there.add(f"{item.reading.source} {item.sensor}")
        if (item.reading.source, item.sensor) == (vehicle, sensor):
            found = True
            yield item.reading.t_s, item.reading.image_bgr
    if not found:
        cameras = ", ".join(sorted(there)) or "none"
        raise OfflineError(
            f"{folder}: has no pictures of '{vehicle} {sensor}' (there are: {cameras}); name them "
            "by --vehicle and --sensor"
        )
