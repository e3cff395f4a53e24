"""A vehicle without GPS: its estimator gets an origin on Earth, and only where it has none."""

import asyncio
from collections.abc import Iterator
from contextlib import nullcontext
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.errors import NotReadyError
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.links.tapped import TappedLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.worlds.geodesy import LocalFrame

HALL = LocalFrame(48.1, 11.5, 520.25)
OF_EARTH = {mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, mavlink.MAVLINK_MSG_ID_HOME_POSITION}
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


def _frames(data: bytes) -> Iterator[bytes]:
    """Yield the frames of unsigned MAVLink 2."""
    while data:
        size = 12 + data[1]
        yield data[:size]
        data = data[size:]


class WithoutGps(TappedLink):
    """The vehicle's end of a link: it says nothing of Earth before its estimator has an origin.

    takes: whether it takes the origin that it is sent.
    """

    def __init__(self, link: Link, *, takes: bool = True, knows: bool = False) -> None:
        super().__init__(link)
        self._reader = MavlinkCodec(system_id=1, component_id=1)
        self._takes, self._knows = takes, knows
        self.origins: list[Any] = []
        self.tap(self._note)

    def _note(self, data: bytes, _: float) -> None:
        for message in self._reader.parse(data):
            if message.get_type() == "SET_GPS_GLOBAL_ORIGIN":
                self.origins.append(message)
                self._knows = self._takes

    def write(self, data: bytes) -> None:
        """Send what is not of Earth, or all."""
        of_earth = set() if self._knows else OF_EARTH
        kept = [one for one in _frames(data) if int.from_bytes(one[7:10], "little") not in of_earth]
        super().write(b"".join(kept))


def _ready(
    autopilot: str,
    *,
    earth: LocalFrame | None,
    takes: bool = True,
    knows: bool = False,
    is_ready: bool = True,
) -> list[Any]:
    """Get a vehicle ready, if it ever is; return the origins that it was sent."""

    async def run() -> list[Any]:
        ours, theirs = memory_pair(latency_s=0.002)
        link = WithoutGps(theirs, takes=takes, knows=knows)
        config = EmbeddedConfig(autopilot=autopilot, running_s=60.0, never_ready=not is_ready)
        async with (
            EmbeddedVehicle(config=config, link=link, seed=1),
            Driver(name="real", link=ours, earth=earth) as driver,
        ):
            await driver.identify(5.0)
            with nullcontext() if is_ready else pytest.raises(NotReadyError):
                await driver.ready(60.0 if is_ready else 10.0)
            await asyncio.sleep(5.0)
            return link.origins

    return run_virtual(run())


@BOTH
def test_it_is_sent_the_worlds_origin_once(autopilot: str) -> None:
    [origin] = _ready(autopilot, earth=HALL)
    assert (origin.target_system, origin.latitude, origin.longitude) == (1, 481000000, 115000000)
    assert origin.altitude == 520250  # mm above mean sea level


@BOTH
def test_an_origin_that_it_has_is_left_alone(autopilot: str) -> None:
    assert _ready(autopilot, earth=HALL, knows=True) == []
    assert _ready(autopilot, earth=HALL, knows=True, is_ready=False) == []


@BOTH
def test_one_that_takes_none_is_not_ready(autopilot: str) -> None:
    with pytest.raises(NotReadyError, match="its estimator has taken no origin on Earth"):
        _ready(autopilot, earth=HALL, takes=False)


def test_a_vehicle_with_gps_is_never_sent_one_and_its_error_says_what_to_do() -> None:
    with pytest.raises(NotReadyError, match=r"unknown: wait for its GPS, or say gps: false"):
        _ready("px4", earth=None)
    assert _ready("ardupilot", earth=None) == []
