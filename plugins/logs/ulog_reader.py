"""Reads PX4's logs (.ulg), by pyulog."""

import math
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from wil_campaign.plugins.logs.logged_flight import FlightLogError, LoggedFlight, PowerSample
from wil_campaign.plugins.logs.track_builder import TrackBuilder
from wil_campaign.vehicles.mavlink.names import enum_name

_TOPICS = ("vehicle_local_position", "vehicle_status", "battery_status")
_POSITION = (
    *("x", "y", "z", "heading", "yaw", "xy_valid", "z_valid"),
    *("xy_global", "z_global", "ref_lat", "ref_lon", "ref_alt"),
)
_BATTERY = ("voltage_v", "voltage_filtered_v", "current_a", "current_filtered_a")
_ARMED = 2
"""vehicle_status.ARMING_STATE_ARMED."""
_HEAD_BYTES, _MESSAGE_HEAD_BYTES = 16, 3
_RELEASES = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: ""}


def read_ulog(path: Path) -> LoggedFlight:
    """Return the flight of a .ulg. Raises LogError."""
    try:
        from pyulog import ULog  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise FlightLogError(
            f"{path} is a log of PX4, which pyulog reads: pip install 'wil-campaign[logs]'"
        ) from error
    try:
        log = ULog(str(path), list(_TOPICS), disable_str_exceptions=True)
    except Exception as error:  # pyulog raises whatever a damaged file causes
        raise FlightLogError(f"{path} cannot be read as a log of PX4 (.ulg): {error}") from error
    track = TrackBuilder()
    for row in _rows(log, "vehicle_local_position", _POSITION):
        _receive_position(track, row)
    parameters = {name: float(value) for name, value in log.initial_parameters.items()}
    for _t_us, name, value in log.changed_parameters:
        parameters[str(name)] = float(value)
    problems = (*_problems(log, path), *track.problems)
    return LoggedFlight(
        kind="a log of PX4",
        autopilot="px4",
        vehicle_type=_vehicle_type(parameters),
        firmware=_firmware(log.msg_info_dict),
        parameters=parameters,
        track=track.track,
        origin=track.origin,
        armed=list(_armed(log)),
        power=list(_power(log)),
        problems=problems,
    )


def _problems(log: Any, path: Path) -> Iterator[str]:
    """Yield what a log lacks: pyulog ends without a word where a file is cut off, or out of step.

    https://docs.px4.io/main/en/dev_guide/ulog_file_format: a head of 16 bytes, and messages, each
    of them with its size (uint16) and type before it.
    """
    data, at = path.read_bytes(), _HEAD_BYTES
    while at + _MESSAGE_HEAD_BYTES <= len(data):
        at += _MESSAGE_HEAD_BYTES + int.from_bytes(data[at : at + 2], "little")
    if at != len(data) or log.file_corruption:
        yield "it is cut off or damaged: its readable part is used"
    if log.dropouts:
        lost_s = sum(dropout.duration for dropout in log.dropouts) * 1e-3
        yield f"its logger lost {lost_s:.2f} s in {len(log.dropouts)} gaps"


def _rows(log: Any, topic: str, names: Collection[str]) -> Iterator[dict[str, float]]:
    """Yield the samples of a topic's first instance, of these fields; times in seconds as `t_s`."""
    for data in log.data_list:
        if data.name == topic and data.multi_id == 0 and "timestamp" in data.data:
            known = [name for name in ("timestamp", *names) if name in data.data]
            columns = [data.data[name].astype(float).tolist() for name in known]
            for values in zip(*columns, strict=True):
                row = dict(zip(known, values, strict=True))
                yield {**row, "t_s": row["timestamp"] * 1e-6}


def _receive_position(track: TrackBuilder, row: dict[str, float]) -> None:
    is_valid = bool(row.get("xy_valid", 1.0) and row.get("z_valid", 1.0))
    track.local(row["t_s"], row["x"], row["y"], row["z"], is_valid=is_valid)
    yaw = row.get("heading", row.get("yaw", math.nan))
    track.yaw(row["t_s"], yaw)
    if row.get("xy_global", 0.0) and row.get("z_global", 0.0):
        degrees = (row.get("ref_lat", 0.0), row.get("ref_lon", 0.0))
        if max(map(abs, degrees)) > 360.0:  # 1e-7 degrees before 2016
            degrees = (degrees[0] * 1e-7, degrees[1] * 1e-7)
        track.set_origin(*degrees, row.get("ref_alt", math.nan))


def _armed(log: Any) -> Iterator[tuple[float, bool]]:
    before: bool | None = None
    for row in _rows(log, "vehicle_status", ("arming_state",)):
        armed = int(row.get("arming_state", 0)) == _ARMED
        if armed is not before:
            yield row["t_s"], armed
            before = armed


def _power(log: Any) -> Iterator[PowerSample]:
    for row in _rows(log, "battery_status", _BATTERY):
        voltage = row.get("voltage_v", row.get("voltage_filtered_v", 0.0))
        current = row.get("current_a", row.get("current_filtered_a", -1.0))
        if math.isfinite(voltage) and voltage > 0.0:
            yield PowerSample(row["t_s"], voltage, current if current >= 0.0 else None)


def _firmware(facts: dict[str, Any]) -> str:
    """Return version and commit in words; empty where the log has none."""
    packed = facts.get("ver_sw_release")
    commit = str(facts.get("ver_sw", ""))
    if not isinstance(packed, int):
        return f"({commit})" if commit else ""
    numbers = ".".join(str(packed >> shift & 0xFF) for shift in (24, 16, 8))
    release = _RELEASES.get(packed & 0xFF, str(packed & 0xFF))
    return f"{numbers}{'-' if release else ''}{release} ({commit})"


def _vehicle_type(parameters: dict[str, float]) -> str:
    """Return the vehicle's type by PX4's parameter; empty where it is not told."""
    number = parameters.get("MAV_TYPE")
    if number is None:
        return ""
    return enum_name("MAV_TYPE", int(number)).removeprefix("MAV_TYPE_").lower()
