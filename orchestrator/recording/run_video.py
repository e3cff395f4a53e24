"""Makes mixed.mp4 of a recorded run, at any time: what the autonomy perceived, from run.mcap."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
from mcap.records import Channel, Message, Metadata
from numpy.typing import NDArray

from wil_campaign.foundation.files.limited_json import loads_limited_json
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap.mcap_chunks import RecordStream
from wil_campaign.orchestrator.recording.mcap.mcap_decode import is_reading_channel, reading_topic
from wil_campaign.orchestrator.recording.mcap.mcap_encode import LOG, PERCEIVED
from wil_campaign.orchestrator.recording.recorded_images import RecordedImages

FILE_NAME = "mixed.mp4"
_NOMINAL_HZ = 30.0
"""For key frames alone; each frame has its own time."""
_BY_MODE = {"sim": "twin", "real": "real"}
"""Whose images a recording without such a line shows, by mode; mixed ones in all others."""


def make_video(folder: Path, *, passed: Callable[[float], None] = lambda _: None) -> bool:
    """Make mixed.mp4 of a run's folder; return whether the recording has images to show.

    passed: called with the time (run clock) of each image. A cut recording gives the video up to
    the cut. A video that is there is replaced by the whole new one. Raises RecordingError, OSError.
    """
    # Reports name the file; PyAV takes a tenth of a second to import.
    from wil_campaign.orchestrator.recording.video import VideoWriter  # noqa: PLC0415

    recording = folder / "run.mcap"
    part = folder / f".{FILE_NAME}.part"
    part.unlink(missing_ok=True)  # of a process that was killed
    try:
        topic = _perceived_topic(recording)
        if topic is None:
            return False
        with VideoWriter(path=part, rate_hz=_NOMINAL_HZ) as video:
            for t_s, image in _images(recording, topic):
                video.write(t_s, image)
                passed(t_s)
        part.replace(folder / FILE_NAME)
    except (KeyError, ValueError, TypeError, IndexError, AttributeError, cv2.error) as error:
        # A recording may come from elsewhere: anything may stand in it.
        why = f"{type(error).__name__}: {error}"
        raise RecordingError(f"{recording}: no video can be made of it: {why}") from error
    finally:
        part.unlink(missing_ok=True)
    return True


def _perceived_topic(recording: Path) -> str | None:
    """Return the topic of the recorded images that were perceived; None where there are none."""
    named: str | None = None
    mode = ""
    sources: dict[str, str] = {}
    others: set[int] = set()
    channels: dict[int, Channel] = {}
    for record in RecordStream(recording):
        if isinstance(record, Metadata) and record.name == "wil.recording":
            mode = record.metadata.get("mode", "")
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message) and record.channel_id not in others:
            channel = channels[record.channel_id]
            if channel.topic == LOG.topic:
                event = loads_limited_json(record.data)
                named = event["message"] if event["name"] == PERCEIVED else named
            else:
                others.add(record.channel_id)  # the first message of a topic tells its type
                if is_reading_channel(channel) and _is_of_camera(record):
                    sources[reading_topic(channel)] = channel.metadata["source"]
        if named in sources:
            return named
    perceived = _BY_MODE.get(mode, "mixed")
    found = (topic for topic, source in sources.items() if source == perceived)
    return None if named else next(found, None)


def _is_of_camera(message: Message) -> bool:
    return bool(loads_limited_json(message.data)["wil"]["type"] == "camera")


def _images(recording: Path, topic: str) -> Iterator[tuple[float, NDArray[Any]]]:
    """Yield times and pixels of a recording's images of a topic, as far as the file is whole."""
    channels: set[int] = set()
    images = RecordedImages({})
    for record in RecordStream(recording):
        if isinstance(record, Metadata) and record.name == "wil.recording":
            images = RecordedImages(record.metadata)
        elif (
            isinstance(record, Channel)
            and is_reading_channel(record)
            and reading_topic(record) == topic
        ):
            channels.add(record.id)
        elif isinstance(record, Message) and record.channel_id in channels:
            document = loads_limited_json(record.data)
            yield float(document["wil"]["t_s"]), images.image(document)
