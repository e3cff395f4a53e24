"""Reads a flight log, whatever its format: told by its first bytes, not by its name."""

import stat
from collections.abc import Callable, Mapping
from pathlib import Path

from wil_campaign.plugins.logs.dataflash_reader import read_dataflash
from wil_campaign.plugins.logs.logged_flight import FlightLogError, LoggedFlight
from wil_campaign.plugins.logs.ros_bag_reader import read_ros_bag
from wil_campaign.plugins.logs.tlog_reader import read_tlog
from wil_campaign.plugins.logs.ulog_reader import read_ulog

_READERS: Mapping[bytes, Callable[[Path], LoggedFlight]] = {
    b"ULog\x01\x12\x35": read_ulog,
    b"\xa3\x95": read_dataflash,
    b"\x89MCAP0\r\n": read_ros_bag,
}
"""By the first bytes of a file."""
_ROS1, _SQLITE = b"#ROSBAG", b"SQLite format 3\0"
_KNOWN = (
    "give a .tlog (MAVLink), .ulg (PX4), .bin (ArduPilot), a bag of ROS 2 in MCAP, or the folder "
    "of a run"
)
_MOST_BYTES = 4 << 30


def read_log(path: Path) -> LoggedFlight:
    """Return the flight in a log. Raises LogError."""
    if path.is_dir():
        return read_log(_log_of_folder(path))
    try:
        state = path.stat()
        if not stat.S_ISREG(state.st_mode):
            raise FlightLogError(f"{path} is not a file")
        if state.st_size > _MOST_BYTES:
            raise FlightLogError(f"{path} is larger than 4 GB: cut the flight out of it")
        with path.open("rb") as stream:
            head = stream.read(16)
    except OSError as error:
        raise FlightLogError(f"{path} cannot be read: {error.strerror or error}") from error
    is_tlog = head[8:9] in {b"\xfd", b"\xfe"} or (head and path.suffix == ".tlog")
    found = (reader for begins, reader in _READERS.items() if head.startswith(begins))
    reader = next(found, read_tlog if is_tlog else None)
    if reader is None:
        raise FlightLogError(f"{path} {_why_not(head)}")
    flight = reader(path)
    if not flight.track and not flight.parameters:
        raise FlightLogError(f"{path} contains no flight: it has no positions and no parameters")
    return flight


def _why_not(head: bytes) -> str:
    """Return in words why a file that begins so is not read, and the remedy."""
    if not head:
        return "is empty"
    if head.startswith(_ROS1):
        return "is a bag of ROS 1; convert it: mcap convert IN.bag OUT.mcap"
    if head.startswith(_SQLITE):
        return "is a bag of ROS 2 in SQLite; convert it: mcap convert IN.db3 OUT.mcap"
    return f"is not a known flight log (it begins with {head[:8]!r}); {_KNOWN}"


def _log_of_folder(folder: Path) -> Path:
    """Return the log in the folder of one of our runs, or of a bag: the judged vehicle's."""
    for name in ("real.tlog", "twin.tlog"):
        if (folder / name).is_file():
            return folder / name
    bags = sorted(folder.glob("*.mcap"))
    if len(bags) == 1:
        return bags[0]
    if any(folder.glob("*.db3")):
        raise FlightLogError(f"{folder} is a bag of ROS 2 in SQLite; convert it: ros2 bag convert")
    raise FlightLogError(
        f"{folder} has no log of a flight (real.tlog, twin.tlog, one .mcap); {_KNOWN}"
    )
