"""Which voices a driver can have, by name."""

from typing import Literal

from vehicles.driver.voice import OwnVoice, Voice
from vehicles.mavsdk.voice import MavsdkVoice

DriverName = Literal["mavlink", "mavsdk"]


def voice_of(driver: DriverName, *, name: str) -> Voice:
    """Return who speaks for the driver of a vehicle; name: of the vehicle, for messages."""
    return MavsdkVoice(name=name) if driver == "mavsdk" else OwnVoice()
