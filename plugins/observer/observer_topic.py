"""The observer's images as a topic of an MCAP file with the stamps of the run's own recording."""

import base64
import json
from collections.abc import Iterable, Mapping
from pathlib import Path

import cv2

from wil_campaign.orchestrator.recording.mcap.mcap_encode import (
    McapChannel,
    McapMessage,
    McapStamps,
)
from wil_campaign.orchestrator.recording.mcap.mcap_file import ChunkedFile
from wil_campaign.vehicles.readings import BgrImage

CHANNEL = McapChannel("/observer/camera", "foxglove.CompressedImage", "observer", "camera")
_QUALITY = 85
_CHUNK_BYTES, _CHUNK_NS = 4_000_000, 1_000_000_000


def write_observer_topic(
    path: Path, frames: Iterable[tuple[float, BgrImage]], facts: Mapping[str, str]
) -> None:
    """Write images with their times (run clock) as JPEG. facts: of the run's recording.

    Raises OSError.
    """
    epoch = facts.get("epoch_ns", "")
    stamps = McapStamps(int(epoch) / 1e9 if epoch.isdecimal() else 0.0)
    file = ChunkedFile(path=path, compression="none", chunk_bytes=_CHUNK_BYTES, chunk_ns=_CHUNK_NS)
    try:
        file.start({"observer_of": f"{facts.get('case')}/{facts.get('mode')}/{facts.get('rep')}"})
        count = 0
        for count, (t_s, image) in enumerate(frames, start=1):
            _, coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
            document = {
                "timestamp": stamps.time(t_s),
                "frame_id": "observer",
                "data": base64.b64encode(coded.tobytes()).decode("ascii"),
                "format": "jpeg",
            }
            at_ns = stamps.ns(t_s)
            file.write(McapMessage(CHANNEL, at_ns, at_ns, count, json.dumps(document).encode()))
        file.finish({CHANNEL.topic: str(count)})
    finally:
        file.close()
