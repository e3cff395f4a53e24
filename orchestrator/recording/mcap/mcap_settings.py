"""Settings of run.mcap: how images are recorded, and the size of its chunks."""

from dataclasses import dataclass
from typing import Literal

from wil_campaign.campaigns.schema import ImageFormat, RecordPart


@dataclass(frozen=True, slots=True)
class ImageSettings:
    """The recording settings of one source's images.

    format: raw and png read back to the bit; png is smaller and some ten times slower than raw.
    quality: of JPEG, 1 to 100. depth, object_ids: whether those of a camera reading are recorded
    too, always exactly. `none` records no images of that source, and nothing with them.
    keeps_drawn: whether images that this program drew are recorded, too; else what they were drawn
    of is, with a digest, and a reader of the recording draws them again.
    """

    format: ImageFormat = "jpeg"
    quality: int = 85
    depth: bool = False
    object_ids: bool = False
    keeps_drawn: bool = True

    def __post_init__(self) -> None:
        if not 1 <= self.quality <= 100:
            raise ValueError(f"JPEG quality is 1 to 100, not {self.quality}")


EXACT = ImageSettings("raw", depth=True, object_ids=True)
"""Records a camera reading completely and exactly."""


@dataclass(frozen=True, slots=True)
class RecordingSettings:
    """The settings of a recording: what, and how.

    chunk_bytes, chunk_s: a chunk is written to the file when it has this size, or spans this time
    of the run clock; so much is lost when the process is killed. backlog_bytes: how much may wait
    for the writing thread; beyond, readings are dropped under a wall clock, and the flight waits
    under a virtual clock.
    """

    real: ImageSettings = ImageSettings()
    twin: ImageSettings = ImageSettings()
    mixed: ImageSettings = ImageSettings()
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    chunk_bytes: int = 512 * 1024
    chunk_s: float = 0.5
    backlog_bytes: int = 64 * 1024 * 1024


LOSSLESS = RecordingSettings(real=EXACT, twin=EXACT, mixed=EXACT)
"""Records everything exactly, so that a mixing replayed from the file does not diverge."""


def recording_settings(record: RecordPart) -> RecordingSettings:
    """Return the recording settings of a campaign.

    A reading has depth and ids only where the recipe needs them, and then a replay needs them too.
    """
    pictures = "jpeg" if record.pictures == "needed" else record.pictures
    images = ImageSettings(
        pictures,
        record.quality,
        depth=True,
        object_ids=True,
        keeps_drawn=record.pictures != "needed",
    )
    return RecordingSettings(real=images, twin=images, mixed=images)
