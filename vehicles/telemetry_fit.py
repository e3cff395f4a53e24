"""Fits telemetry rates to a radio's bandwidth; pure."""

from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import Autopilot, TelemetryRates

LEAST_HZ = 10.0
"""With less frequent positions the guard would notice a breach too late."""
SHARE_DOWN = 0.5
"""Fraction of a radio's bandwidth for the vehicle's telemetry: both directions share the channel,
setpoints and repeated frames need the rest."""
_FRAME_BYTES = 12
_SIGNATURE_BYTES = 13
_UNPLANNED = (
    (mavlink.MAVLINK_MSG_ID_HEARTBEAT, 1.0),
    (mavlink.MAVLINK_MSG_ID_TIMESYNC, 12.0),
)
"""Messages that arrive without being in the plan; TIMESYNC requests are sent in bursts."""


class RadioTooSlowError(ValueError):
    """A radio is too slow for the telemetry that the guard needs; says what would fit."""


def telemetry_bytes_s(autopilot: Autopilot, rates: TelemetryRates, *, signed: bool) -> float:
    """Return a vehicle's telemetry at such rates in bytes per second, at most.

    MAVLink 2 frames have 12 bytes beside their payload, 13 more when they are signed.
    """
    plan = [
        (message_rate.message_id, message_rate.rate_hz)
        for message_rate in autopilot.telemetry_plan(rates)
    ]
    return sum(_frame_bytes(number, signed=signed) * hz for number, hz in (*plan, *_UNPLANNED))


def fitted_telemetry_rates(
    autopilot: Autopilot, wanted: TelemetryRates, *, radio_bit_s: float, signed: bool = False
) -> TelemetryRates:
    """Return the wanted telemetry rates fitted to a radio: positions and attitudes less often.

    A simulator's ground truth comes as often as positions do.

    radio_bit_s: what the radio carries in a second, both ways together. Raises RadioTooSlowError
    when fewer than 10 positions in a second fit.
    """
    room_bytes_s = SHARE_DOWN * radio_bit_s / 8.0
    truth = 1.0 if wanted.truth_hz > 0.0 else 0.0
    still = replace(wanted, position_hz=0.0, attitude_hz=0.0, truth_hz=0.0)
    fixed_bytes_s = telemetry_bytes_s(autopilot, still, signed=signed)
    one_hz = replace(wanted, position_hz=1.0, attitude_hz=1.0, truth_hz=truth)
    per_hz = telemetry_bytes_s(autopilot, one_hz, signed=signed) - fixed_bytes_s
    fits_hz = float(max(0, int((room_bytes_s - fixed_bytes_s) / per_hz)))
    if fits_hz < min(LEAST_HZ, wanted.position_hz):
        raise RadioTooSlowError(
            f"a radio of {radio_bit_s / 1e3:g} kbit/s carries {fits_hz:.0f} positions a second, "
            f"and the guard needs {LEAST_HZ:.0f}; use a faster radio"
        )
    return replace(
        wanted,
        position_hz=min(wanted.position_hz, fits_hz),
        attitude_hz=min(wanted.attitude_hz, fits_hz),
        truth_hz=min(wanted.truth_hz, fits_hz),
    )


def _frame_bytes(message_id: int, *, signed: bool) -> int:
    """Return a telemetry frame's size in bytes, with or without signature."""
    payload: int = mavlink.mavlink_map[message_id].unpacker.size
    return payload + _FRAME_BYTES + (_SIGNATURE_BYTES if signed else 0)
