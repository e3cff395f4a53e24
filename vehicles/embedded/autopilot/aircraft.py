"""What an emulated autopilot flies, and what its firmware has."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import EmulatedIdentity
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import ItemRules
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable
from wil_campaign.vehicles.embedded.autopilot.services.discovery import ModeEntry
from wil_campaign.vehicles.embedded.autopilot.services.log_formats import LogWriter
from wil_campaign.vehicles.embedded.autopilot.services.message_hub import MessageRules
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.physics.body import FlyingBody


@dataclass(frozen=True, slots=True, kw_only=True)
class EmulatedAircraft:
    """What an emulated autopilot flies. overrides: of its parameters. dt_s: of a physics step.

    full_streams: whether it sends all streams of the firmware, not only those that a run needs.
    body: its simulator's ground truth is the autopilot's, and its step runs the law.
    """

    identity: EmulatedIdentity
    airframe: Airframe
    dt_s: float
    body: FlyingBody
    overrides: Mapping[str, float]
    full_streams: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class FirmwareTraits:
    """What a firmware has, and how it differs in services that both have.

    messages: see `MessageRules`.

    mode_entries: in AVAILABLE_MODES. other_mode: MISSION_CURRENT.mission_mode outside of missions.
    first_mission_item: 1 where item 0 is home. refused: MAV_RESULT of an arm or disarm command that
    the checks refuse. set_mode_ack: what acknowledges SET_MODE; None: nothing. gps_time_s: when the
    GPS receiver has the time of day, s since boot. numbers_texts: gives each STATUSTEXT an id.
    bytewise: an integer parameter's bits travel in the float field. strict_parameters: see
    `ParameterService`. files: served over MAVLink, by path. heights_relative: reads the
    height of a command by its frame, not always as above mean sea level.
    """

    mav_autopilot: int
    messages: MessageRules
    parameter_file: Path
    bytewise: bool
    strict_parameters: bool
    files: Mapping[str, Callable[[ParameterTable], bytes]]
    item_rules: ItemRules
    first_mission_item: int
    mode_entries: tuple[ModeEntry, ...]
    other_mode: int
    refused: int
    set_mode_ack: int | None
    heights_relative: bool
    numbers_texts: bool
    log_format: Callable[[int, ParameterTable], LogWriter]
    first_log: int
    gps_time_s: float
