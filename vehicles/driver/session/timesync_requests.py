"""Sends TIMESYNC requests to the vehicle: a burst at first, then about two a second."""

import asyncio
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver.session.repeater import Repeater
from wil_campaign.vehicles.driver.session.session import MavlinkSession

_BURST = 10
_BURST_PERIOD_S = 0.0937
_PERIOD_S = 0.4871
"""Not multiples of a simulated clock's steps: requests at many phases show the clock's phase."""


class TimesyncRequester:
    """Sends TIMESYNC requests and feeds the replies to a VehicleClock.

    The autopilot's own TIMESYNC requests are not answered: what we send is stamped by its clock.
    """

    def __init__(self, *, session: MavlinkSession, clock: VehicleClock) -> None:
        self._session = session
        self._clock = clock
        self._sent = 0
        self._burst = Repeater(period_s=_BURST_PERIOD_S, action=self._request_in_burst)
        self._steady = Repeater(period_s=_PERIOD_S, action=self._request)
        session.on(mavlink.MAVLINK_MSG_ID_TIMESYNC, self._on_reply)

    def start(self) -> None:
        """Start with a burst of TIMESYNC requests."""
        self._sent = 0
        self._steady.stop()
        self._burst.start()

    def stop(self) -> None:
        """Stop TIMESYNC requests."""
        self._burst.stop()
        self._steady.stop()

    def _request_in_burst(self) -> None:
        if self._sent >= _BURST:
            self._burst.stop()
            self._steady.start()
            return
        self._request()

    def _request(self) -> None:
        self._sent += 1
        stamp = self._clock.ask(asyncio.get_running_loop().time())
        self._session.send(mavlink.MAVLink_timesync_message(0, stamp))

    def _on_reply(self, message: Any, t_s: float) -> None:
        self._clock.answered(tc1=message.tc1, ts1=message.ts1, arrived_s=t_s)
