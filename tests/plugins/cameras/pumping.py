"""From `async for` to a callback."""

from collections.abc import Callable

from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.sources.camera_source import CameraSource


async def pump(source: CameraSource, deliver: Callable[[CameraReading], None]) -> None:
    """Hand every image of an open source to a callback; raises what the source raises."""
    async for reading in source:
        deliver(reading)
