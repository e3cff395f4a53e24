"""The command backends of a driver, by the name in a campaign."""

from typing import Literal

from vehicles.driver.command_backend import CommandBackend, FrameBackend
from vehicles.mavsdk.mavsdk_backend import MavsdkBackend

DriverName = Literal["mavlink", "mavsdk"]


def command_backend_of(driver: DriverName, *, name: str) -> CommandBackend:
    """Return the command backend of a driver; name: of the vehicle, for messages."""
    return MavsdkBackend(name=name) if driver == "mavsdk" else FrameBackend()
