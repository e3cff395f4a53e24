"""A vehicle's identity, from its AUTOPILOT_VERSION and heartbeat; pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import Autopilot, MavlinkTarget, has_board_ids
from wil_campaign.vehicles.autopilots.registry import (
    MULTICOPTERS,
    autopilot_named,
    autopilot_of,
    autopilot_strategies,
)
from wil_campaign.vehicles.driver.session.session import HeartbeatSender, ReceivedHeartbeat
from wil_campaign.vehicles.mavlink.names import enum_name

_AUTOPILOT: int = mavlink.MAV_COMP_ID_AUTOPILOT1
_RELEASES = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: ""}
"""FIRMWARE_VERSION_TYPE, the lowest byte of flight_sw_version."""


@dataclass(frozen=True, slots=True)
class VehicleIdentity:
    """The identity of a vehicle: autopilot, version, board, system id.

    version: (major, minor, patch); version_text adds the kind of release ("4.7.0-dev").
    uid: AUTOPILOT_VERSION.uid2 where it is set, else uid, in hex. simulation: whether it shows
    that it is one; then its uid is not unique (PX4's is a constant plus the system id, ArduPilot's
    that of the machine). board: its vendor, product and board ids, in hex; empty where it names
    none.
    """

    autopilot: str
    system_id: int
    component_id: int
    vehicle_type: str
    version: tuple[int, int, int]
    version_text: str
    git_hash: str
    uid: str
    capabilities: int
    simulation: bool
    board: str = ""


def identity_of(
    autopilot: Autopilot,
    target: MavlinkTarget,
    received: ReceivedHeartbeat,
    version: Any,
    *,
    is_simulated: bool,
) -> VehicleIdentity:
    """Return the identity in a heartbeat and an AUTOPILOT_VERSION.

    is_simulated: whether it has sent its `simulation_message_id`.
    """
    packed = version.flight_sw_version
    numbers = (packed >> 24 & 0xFF, packed >> 16 & 0xFF, packed >> 8 & 0xFF)
    release = _RELEASES.get(packed & 0xFF, str(packed & 0xFF))
    text = ".".join(map(str, numbers)) + (f"-{release}" if release else "")
    uid2 = bytes(version.uid2)
    return VehicleIdentity(
        autopilot=autopilot.name,
        system_id=target.system,
        component_id=target.component,
        vehicle_type=_type_name(received.vehicle_type),
        version=numbers,
        version_text=text,
        git_hash=_git_hash(bytes(version.flight_custom_version)),
        uid=uid2.hex() if any(uid2) else f"{version.uid:016x}",
        capabilities=version.capabilities,
        simulation=autopilot.is_simulation(version, target.system, shows_it=is_simulated),
        board=_board_text(version),
    )


@dataclass(frozen=True, slots=True)
class WantedVehicle:
    """The vehicle that is wanted on a link; None for any."""

    autopilot: str | None = None
    system_id: int | None = None

    def __str__(self) -> str:
        """Return the wanted identity in words."""
        which = f"{self.autopilot or _known()} multicopter"
        return which if self.system_id is None else f"{which} with system id {self.system_id}"


def matching_vehicle(
    heartbeats: Mapping[HeartbeatSender, ReceivedHeartbeat], wanted: WantedVehicle
) -> tuple[HeartbeatSender, Autopilot] | None:
    """Return the first received vehicle of the wanted identity that we can fly.

    Its component id is 1, by which guard and links know the autopilot's frames.
    """
    for sender, each in heartbeats.items():
        if sender.component != _AUTOPILOT:
            continue
        strategy = autopilot_of(each.autopilot)
        if strategy is None or each.vehicle_type not in MULTICOPTERS or each.mavlink_version < 2:
            continue
        if wanted.autopilot in {None, strategy.name} and wanted.system_id in {None, sender.system}:
            return sender, strategy
    return None


def unsupported_version(identity: VehicleIdentity) -> str:
    """Return in words that an autopilot's version is too old; empty when it is supported."""
    oldest = autopilot_named(identity.autopilot).oldest_version
    if identity.version[:2] >= oldest or identity.version == (0, 0, 0):
        return ""
    return (
        f"it runs {identity.autopilot} {identity.version_text}, and {oldest[0]}.{oldest[1]} is the "
        "oldest that is supported; update its firmware"
    )


def same_vehicle(one: VehicleIdentity, other: VehicleIdentity) -> bool:
    """Return whether two identities are of the same vehicle, by its board's unique id."""
    shared = one.simulation or other.simulation or not one.uid.strip("0")
    return one.uid == other.uid and not shared


def describe_mismatches(
    heartbeats: Mapping[HeartbeatSender, ReceivedHeartbeat], wanted: WantedVehicle
) -> str:
    """Return in words why none of the received vehicles is the wanted one."""
    lines = [_describe_mismatch(sender.target, each, wanted) for sender, each in heartbeats.items()]
    if all(each.vehicle_type == mavlink.MAV_TYPE_GCS for each in heartbeats.values()):
        systems = ", ".join(
            str(fromkey) for fromkey in dict.fromkeys(heartbeat.system for heartbeat in heartbeats)
        )
        return f"heartbeats of system {systems} only: this is a ground station's port"
    return "; ".join(lines)


def _describe_mismatch(
    target: MavlinkTarget, received: ReceivedHeartbeat, wanted: WantedVehicle
) -> str:
    """Return in words why a received vehicle is not the wanted one."""
    sender = f"system {target.system} component {target.component}"
    kind = _type_name(received.vehicle_type)
    strategy = autopilot_of(received.autopilot)
    if received.vehicle_type == mavlink.MAV_TYPE_GCS:
        return f"{sender} is a ground station"
    if strategy is None:
        autopilot = enum_name("MAV_AUTOPILOT", received.autopilot)
        return f"{sender} is a {kind} with {autopilot}, which is not {_known()}"
    return f"{sender} {_describe_own_kind(target, received, strategy.name, wanted)}"


def _known() -> str:
    """Return the autopilots that we can fly, in words."""
    return " or ".join(strategy.label for strategy in autopilot_strategies().values())


def _describe_own_kind(
    target: MavlinkTarget, received: ReceivedHeartbeat, name: str, wanted: WantedVehicle
) -> str:
    """Return in words why a received vehicle of a known autopilot is not the wanted one."""
    kind = _type_name(received.vehicle_type)
    if received.vehicle_type not in MULTICOPTERS:
        return f"is a {kind} of {name}, and only multicopters are supported"
    if target.component != _AUTOPILOT:
        return (
            f"is {name}, and only autopilots with component id {_AUTOPILOT} are supported; set its "
            f"component id to {_AUTOPILOT} (PX4: MAV_COMP_ID)"
        )
    if received.mavlink_version < 2:
        return "sends MAVLink 1 only; set its port to MAVLink 2"
    if wanted.autopilot not in {None, name}:
        return f"is {name}, and {wanted.autopilot} was requested"
    return f"is a {kind} of {name}"


def _board_text(version: Any) -> str:
    """Return the board's ids in an identity's AUTOPILOT_VERSION; empty where it names none."""
    if not has_board_ids(version):
        return ""
    return (
        f"vendor {version.vendor_id:04x}, product {version.product_id:04x}, board "
        f"{version.board_version:x}"
    )


def _type_name(vehicle_type: int) -> str:
    return enum_name("MAV_TYPE", vehicle_type).removeprefix("MAV_TYPE_").lower()


def _git_hash(raw: bytes) -> str:
    # ArduPilot writes the hash as text, PX4 as a little-endian number.
    if all(48 <= byte < 127 for byte in raw):
        return raw.decode("ascii")
    return raw[::-1].hex()
