"""The settings of a standalone embedded vehicle, for use by other programs."""

import math
import time
from collections.abc import Iterable, Mapping
from pathlib import Path

from wil_campaign.foundation.files.documents import closest_word, load_document
from wil_campaign.vehicles.embedded.autopilot.known_parameters import known_parameters
from wil_campaign.vehicles.embedded.physics.contact_world import contact_world_argument
from wil_campaign.vehicles.embedded.process.process_settings import (
    ContactWorldSettings,
    ProcessSettings,
)
from wil_campaign.vehicles.embedded.profile import load_profile
from wil_campaign.vehicles.faults import parse_fault
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.worlds.world_file.world import World


def standalone_settings(
    autopilot: str,
    link: str,
    *,
    profile: str = "nominal",
    world: Path | None = None,
    speed: float = 1.0,
    seed: int = 1,
    system_id: int = 1,
    running_s: float = 0.0,
    parameters: Mapping[str, float] | None = None,
    faults: Iterable[str] = (),
) -> ProcessSettings:
    """Return the settings of an embedded vehicle at a link, with the streams of its firmware.

    link: seen from the vehicle. profile: a name, or a YAML file. world: a world file, for its
    origin and its obstacles. faults: texts of `parse_fault`. Raises LinkAddressError, ProfileError,
    FaultError, BadInput, pydantic's ValidationError, and ValueError for an unknown parameter.
    """
    parse_link(link)
    load_profile(profile)
    for name in parameters or {}:
        check_parameter(autopilot, name)
    settings = ProcessSettings(
        autopilot=autopilot,
        link=link,
        seed=seed,
        profile=profile,
        system_id=system_id,
        parameters=dict(parameters or {}),
        full_streams=True,
        speed=speed,
        running_s=running_s,
        boot_unix_us=time.time_ns() // 1000 - _microseconds(running_s),
        end_with_parent=False,
        faults=tuple(str(parse_fault(text)) for text in faults),
    )
    return settings if world is None else _in_world(settings, world)


def _microseconds(running_s: float) -> int:
    """Return a time in microseconds; 0 for one that the settings refuse by name."""
    return round(running_s * 1e6) if math.isfinite(running_s) else 0


def check_parameter(autopilot: str, name: str) -> None:
    """Raise ValueError for a parameter that the embedded autopilot does not have."""
    known = known_parameters(autopilot)
    if name not in known:
        meant = closest_word(name, known)
        hint = f"; did you mean '{meant}'?" if meant else ""
        raise ValueError(f"the embedded {autopilot} has no parameter '{name}'{hint}")


def _in_world(settings: ProcessSettings, file: Path) -> ProcessSettings:
    """Return a vehicle's settings with a world's origin and obstacles. Raises BadInput."""
    document = load_document(file)
    frame = World.parse(document).frame
    return settings.model_copy(
        update={
            "latitude_deg": frame.latitude_deg,
            "longitude_deg": frame.longitude_deg,
            "altitude_m": frame.altitude_m,
            "contact_world": ContactWorldSettings(
                use="wil_campaign.vehicles.embedded.physics.contact_world:from_argument",
                argument=contact_world_argument(document, "real", "W"),
            ),
        }
    )
