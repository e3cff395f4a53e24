"""The fix and the ground speed of the vehicle's GPS receiver: GPS_RAW_INT."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import command_long
from wil_campaign.vehicles.driver.session.session import MavlinkSession

_REQUEST_AGAIN_S = 0.5
_UNKNOWN_HDOP = 0xFFFF
_UNKNOWN_COUNT = 0xFF
_UNKNOWN_SPEED = 0xFFFF


@dataclass(frozen=True, slots=True)
class GpsFix:
    """A fix of the vehicle's GPS receiver; unknown values are None.

    kind: GPS_FIX_TYPE: 0 no receiver, 1 no fix, 2 without height, 3 or more with height. hdop:
    dilution of the horizontal position, no unit.
    """

    kind: int
    satellites: int | None
    hdop: float | None


class GroundSpeed(NamedTuple):
    """A horizontal speed by the vehicle's GPS receiver, which measures it by Doppler shift.

    arrived_s: time of arrival (run clock). accuracy_m_s: one standard deviation as the receiver
    states it, None when it does not.
    """

    arrived_s: float
    speed_m_s: float
    accuracy_m_s: float | None


class GpsReceiver:
    """Requests the fix of the vehicle's GPS receiver, and passes its ground speed on."""

    def __init__(self, *, session: MavlinkSession) -> None:
        self._session = session
        self._newest: GpsFix | None = None
        self._arrived = asyncio.Event()
        self._speed_listeners: list[Callable[[GroundSpeed], None]] = []
        session.on(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, self._take)

    def on_ground_speed(self, listener: Callable[[GroundSpeed], None]) -> None:
        """Call `listener` with each horizontal speed of a fix; the driver requests them."""
        self._speed_listeners.append(listener)

    async def fix(self, timeout_s: float) -> GpsFix | None:
        """Request and return the GPS receiver's fix; None without a reply within `timeout_s`."""
        target = self._session.target
        if target is None:
            return None
        message = command_long(
            target, mavlink.MAV_CMD_REQUEST_MESSAGE, float(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT)
        )
        self._arrived.clear()
        for _ in range(max(1, round(timeout_s / _REQUEST_AGAIN_S))):
            self._session.send(message)
            try:
                async with asyncio.timeout(_REQUEST_AGAIN_S):
                    await self._arrived.wait()
            except TimeoutError:
                continue
            return self._newest
        return None

    def _take(self, message: Any, t_s: float) -> None:
        seen, hdop = message.satellites_visible, message.eph
        self._newest = GpsFix(
            kind=message.fix_type,
            satellites=None if seen == _UNKNOWN_COUNT else seen,
            hdop=None if hdop == _UNKNOWN_HDOP else hdop * 0.01,
        )
        self._arrived.set()
        if message.fix_type < mavlink.GPS_FIX_TYPE_3D_FIX or message.vel == _UNKNOWN_SPEED:
            return
        accuracy_m_s = message.vel_acc * 1e-3 if message.vel_acc else None
        speed = GroundSpeed(t_s, message.vel * 0.01, accuracy_m_s)
        for listener in self._speed_listeners:
            listener(speed)
