"""Readings of IMUs in MAVLink's messages; pure.

https://mavlink.io/en/messages/common.html: SCALED_IMU is in milli-g and mrad/s, HIGHRES_IMU in m/s2
and rad/s. RAW_IMU has no unit there: ArduPilot fills it as SCALED_IMU (GCS_Common.cpp,
send_raw_imu), and only its is accepted.
"""

from typing import Any

from wil_campaign.vehicles.readings import ImuReading
from wil_campaign.vehicles.sources.readings.live_readings import UnusableReadingError
from wil_campaign.vehicles.sources.readings.mavlink_messages import (
    HasState,
    MavlinkReading,
    MavlinkSensor,
    MessageTimes,
    Reader,
)

_MILLI = 0.001
_STANDARD_G = 9.80665
"""ISO 80000-3; what ArduPilot and PX4 scale by."""
_ACCELERATION, _RATES = 0b000_111, 0b111_000
"""HIGHRES_IMU_UPDATED_FLAGS."""


def imu_reading(message: Any, times: MessageTimes) -> ImuReading:
    """Return the reading in HIGHRES_IMU, SCALED_IMU or ArduPilot's RAW_IMU, body FRD."""
    acceleration = (message.xacc, message.yacc, message.zacc)
    rates = (message.xgyro, message.ygyro, message.zgyro)
    if message.get_type() == "HIGHRES_IMU":
        both = _ACCELERATION | _RATES
        if message.fields_updated & both != both:
            raise UnusableReadingError("its fields_updated lacks accelerations or rates")
    else:
        acceleration = tuple(a * _MILLI * _STANDARD_G for a in acceleration)
        rates = tuple(r * _MILLI for r in rates)
    return ImuReading(
        *times.stamps,
        specific_force_frd_m_s2=(acceleration[0], acceleration[1], acceleration[2]),
        rates_frd_rad_s=(rates[0], rates[1], rates[2]),
    )


def _reader(sensor: MavlinkSensor, vehicle: HasState) -> Reader:
    del sensor, vehicle
    return imu_reading


MESSAGES = MavlinkReading(
    ("HIGHRES_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "RAW_IMU"), _reader
)
