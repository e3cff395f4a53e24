"""`wil-campaign export`: a recorded run as a bag of ROS 2."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from wil_campaign.foundation.files.paths import is_file, is_folder, path_exists
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.plugins.ros2.bags.bag_file_of_run import trouble
from wil_campaign.plugins.ros2.bags.whole_file import whole_file
from wil_campaign.plugins.ros2.ros2_part import Distribution

if TYPE_CHECKING:
    from wil_campaign.plugins.ros2.bags.recorded_bag import WrittenBag


def export(
    run: Path,
    *,
    ros2: Path,
    decode: Annotated[bool, Parameter(negative=())] = False,
    cut: Annotated[bool, Parameter(negative=())] = False,
    distribution: Distribution = "jazzy",
) -> int:
    """Write a recorded run as a bag of ROS 2: one MCAP file, which ROS need not be there for.

    Exits with 2 for a recording that is not there or cut off, and for a file that exists.

    Parameters
    ----------
    run
        A run's folder, or its run.mcap.
    ros2
        The bag to write, as flight.mcap.
    decode
        Write images as sensor_msgs/Image, for nodes that subscribe to no others. Without it they
        are CompressedImage, with the bytes of the recording.
    cut
        Export a recording that is cut off as far as it is whole.
    distribution
        The distribution of ROS 2 whose message definitions are used.
    """
    recording = run / "run.mcap" if is_folder(run) else run
    if fault := _fault_of(recording, ros2):
        write_stderr(fault)
        return 2
    from wil_campaign.plugins.ros2.bags.recorded_bag import DAMAGED, write_bag  # noqa: PLC0415
    from wil_campaign.plugins.ros2.messages.ros_types import ros_types  # noqa: PLC0415 - an extra

    try:
        with whole_file(ros2) as stream:
            types = ros_types(distribution)
            written = write_bag(recording, stream, types, decodes=decode, allows_cut=cut)
    except RecordingError as error:
        write_stderr(error)
        return 2
    except OSError as error:
        write_stderr(f"{error.filename or ros2}: {error.strerror or error}")
        return 3
    except DAMAGED as error:
        write_stderr(f"{recording}: cannot be read: {type(error).__name__}: {error}")
        return 2
    _report(ros2, written)
    return 0


def _fault_of(recording: Path, file: Path) -> str:
    """Return why a recording cannot be exported into a file; "" where nothing is in the way."""
    if not is_file(recording):
        return f"{recording}: there is no such recording; name a run's folder, or its run.mcap"
    if path_exists(file):
        return f"{file}: is there already; name another file, or remove it"
    if file.suffix != ".mcap":
        return f"{file}: name a file that ends in .mcap, by which tools of ROS know its storage"
    if not is_folder(file.parent):
        return f"{file}: there is no folder {file.parent}; create it"
    return trouble()


def _report(file: Path, written: "WrittenBag") -> None:
    counts = written.counts
    write_stdout(f"written: {file}, {sum(counts.values())} messages on {len(counts)} topics")
    for topic, count in sorted(written.left_out.items()):
        why = "for which there is no message, or no topic of their own"
        write_stderr(f"left out: {count} readings of {topic}, {why}")
    for problem in written.lacks:
        write_stderr(f"no poses, or not all of them: {problem}")
