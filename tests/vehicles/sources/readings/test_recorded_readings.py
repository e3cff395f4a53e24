"""A recorded sensor whose source, of a plugin, never ends and never delivers a usable reading."""

import asyncio
import math

import pytest

from wil_campaign.vehicles.readings import RangefinderReading, Reading
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.readings import recorded_readings
from wil_campaign.vehicles.sources.readings.recorded_readings import RecordedReadings


class EndlessFile:
    """Delivers readings for ever: none with a distance."""

    name = "lab://1"
    unusable = 0

    def __init__(self) -> None:
        self.t_s = 0.0

    def open(self) -> None:
        pass

    def next(self) -> Reading:
        self.t_s += 0.05
        return RangefinderReading(
            self.t_s, self.t_s, 0, "real", range_m=math.nan, range_min_m=0.1, range_max_m=9.0
        )

    def close(self) -> None:
        pass


def test_an_endless_source_without_a_usable_reading_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(recorded_readings, "_MOST_FAULTY", 50, raising=False)

    async def main() -> None:
        readings = RecordedReadings(file=EndlessFile(), side="real")
        with pytest.raises(SourceError, match=r"^lab://1: 50 readings in a row are of no use"):
            async with asyncio.timeout(5.0):
                await readings.__aenter__()

    asyncio.run(main())
