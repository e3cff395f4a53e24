"""Asks the vehicle for its time: often at first, then now and then."""

import asyncio
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.clocks.timesync import VehicleClock
from vehicles.driver.session.repeater import Repeater
from vehicles.driver.session.session import Session

_BURST = 10
_BURST_PERIOD_S = 0.0937
_PERIOD_S = 0.4871
"""No multiples of the steps of a simulated clock: its phase shows when asked at many phases."""


class TimesyncRequester:
    """Sends TIMESYNC requests and feeds the replies to a VehicleClock.

    We do not answer the autopilot's own questions: what we send is stamped by its clock.
    """

    def __init__(self, *, session: Session, clock: VehicleClock) -> None:
        self._session = session
        self._clock = clock
        self._sent = 0
        self._burst = Repeater(period_s=_BURST_PERIOD_S, action=self._ask_in_burst)
        self._steady = Repeater(period_s=_PERIOD_S, action=self._ask)
        session.on(mavlink.MAVLINK_MSG_ID_TIMESYNC, self._on_answer)

    def start(self) -> None:
        """Start with a burst of TIMESYNC requests."""
        self._sent = 0
        self._steady.stop()
        self._burst.start()

    def stop(self) -> None:
        """Stop TIMESYNC requests."""
        self._burst.stop()
        self._steady.stop()

    def _ask_in_burst(self) -> None:
        if self._sent >= _BURST:
            self._burst.stop()
            self._steady.start()
            return
        self._ask()

    def _ask(self) -> None:
        self._sent += 1
        stamp = self._clock.ask(asyncio.get_running_loop().time())
        self._session.send(mavlink.MAVLink_timesync_message(0, stamp))

    def _on_answer(self, message: Any, t_s: float) -> None:
        self._clock.answered(tc1=message.tc1, ts1=message.ts1, arrived_s=t_s)
