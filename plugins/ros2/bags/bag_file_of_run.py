"""`record: {also: [ros2]}`: the bag that a run gets beside its recording, after the landing."""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import IO, cast

from wil_campaign.plugins.ros2.bags.whole_file import whole_file
from wil_campaign.plugins.ros2.ros2_part import INSTALL

FILE_NAME = "ros2.mcap"
_DISTRIBUTION = "jazzy"
"""Of the definitions, which the bag has with it."""


def trouble() -> str:
    """Return why no bag can be written here; "" where it can."""
    return "" if find_spec("rosbags") else f"bags of ROS 2 need rosbags: {INSTALL}"


def write(folder: Path, passed: Callable[[], None]) -> str:
    """Write the bag of a run; return its name. Raises RecordingError, OSError."""
    from wil_campaign.plugins.ros2.bags.recorded_bag import write_bag  # noqa: PLC0415 - of an extra
    from wil_campaign.plugins.ros2.messages.ros_types import ros_types  # noqa: PLC0415

    file = folder / FILE_NAME
    file.unlink(missing_ok=True)
    with whole_file(file) as stream:
        reporting = cast("IO[bytes]", _Reporting(stream, passed))
        types = ros_types(_DISTRIBUTION)
        write_bag(folder / "run.mcap", reporting, types, decodes=False, allows_cut=True)
    return FILE_NAME


class _Reporting:
    """A stream for a writer of MCAP, which says with each write that it goes on."""

    def __init__(self, stream: IO[bytes], passed: Callable[[], None]) -> None:
        self._stream = stream
        self._passed = passed

    def write(self, data: bytes) -> int:
        """Write bytes; return how many."""
        self._passed()
        return self._stream.write(data)

    def __getattr__(self, name: str) -> object:
        """Return anything else of the stream."""
        return getattr(self._stream, name)
