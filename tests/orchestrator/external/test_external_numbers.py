"""Readings from outside, as of a plugin's source: with numbers that can be recorded."""

from collections.abc import AsyncIterator
from typing import Any, Self

import numpy as np
import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.external.external_sources import ExternalSource
from wil_campaign.vehicles.readings import RangefinderReading, Reading
from wil_campaign.vehicles.sources.camera_source import SourceCounts, SourceError


class Lab:
    """Delivers one reading, with numbers of NumPy."""

    name, kind, counts = "lab://1", "file", SourceCounts()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        pass

    async def __aiter__(self) -> AsyncIterator[Reading]:
        number: Any = np.float32(1.5)
        seq: Any = np.int64(3)
        yield RangefinderReading(
            1e3, 1e3, seq, "real", range_m=number, range_min_m=0.1, range_max_m=9.0
        )


def test_numbers_of_numpy_are_python_s_before_anything_is_recorded() -> None:
    found: list[Any] = []
    make: Any = Lab

    async def main() -> None:
        source = ExternalSource(sensor="down", shown_as="file", side="real", make=make)
        with pytest.raises(SourceError, match="the recording is over"):
            await source.run(found.append)

    run_virtual(main())
    (reading,) = found
    assert (type(reading.range_m), type(reading.seq)) == (float, int)
