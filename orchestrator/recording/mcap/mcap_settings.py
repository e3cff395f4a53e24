"""What run.mcap holds of pictures, and how it is cut into chunks."""

from dataclasses import dataclass
from typing import Literal

from campaigns.schema import ImageFormat, RecordPart


@dataclass(frozen=True, slots=True)
class ImageSettings:
    """The recording settings of one source's images.

    format: raw and png read back to the bit; png is smaller and some ten times slower than raw.
    quality: of JPEG, 1 to 100. depth, object_ids: whether those of a camera reading are recorded
    too, always exactly. `none` records no picture of that source, and nothing with it.
    """

    format: ImageFormat = "jpeg"
    quality: int = 85
    depth: bool = False
    object_ids: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.quality <= 100:
            raise ValueError(f"JPEG quality is 1 to 100, not {self.quality}")


EXACT = ImageSettings("raw", depth=True, object_ids=True)
"""All of a camera reading, to the bit."""


@dataclass(frozen=True, slots=True)
class RecordingSettings:
    """The settings of a recording: what, and how.

    chunk_bytes, chunk_s: a chunk is written to the file when it holds this much, or spans this
    much of the run clock: what is lost when the process is killed. backlog_bytes: how much may
    wait for the writing thread; beyond, a wall clock drops and a virtual clock waits.
    """

    real: ImageSettings = ImageSettings()
    twin: ImageSettings = ImageSettings()
    mixed: ImageSettings = ImageSettings()
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    chunk_bytes: int = 512 * 1024
    chunk_s: float = 0.5
    backlog_bytes: int = 64 * 1024 * 1024


LOSSLESS = RecordingSettings(real=EXACT, twin=EXACT, mixed=EXACT)
"""Everything to the bit, so that a mixing replayed from the file does not diverge."""


def recording_settings(record: RecordPart) -> RecordingSettings:
    """Return the recording settings of a campaign.

    Depth and ids are in a reading only where the recipe needs them, and then a replay does too.
    """
    pictures = ImageSettings(record.pictures, record.quality, depth=True, object_ids=True)
    return RecordingSettings(real=pictures, twin=pictures, mixed=pictures)
