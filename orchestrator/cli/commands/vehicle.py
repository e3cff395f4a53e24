"""`wil-campaign vehicle`: an embedded vehicle alone in a process, at a link for any program."""

import time
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from pydantic import ValidationError

from orchestrator.cli.standard_streams import err
from vehicles.embedded.autopilot.known_parameters import known_parameters
from vehicles.embedded.physics.contact_world import as_argument
from vehicles.embedded.process.embedded_process import run_process
from vehicles.embedded.process.process_settings import ContactWorldSettings, ProcessSettings
from vehicles.embedded.profile import ProfileError, load_profile
from vehicles.links.link_strings import LinkAddressError, parse_link
from worlds.files.documents import closest, load
from worlds.world_file.world import World

_BAD_INPUT, _UNAVAILABLE = 2, 3
_LINKS = {"px4": "udpout://127.0.0.1:14540", "ardupilot": "tcpin://127.0.0.1:5760"}


def vehicle(
    autopilot: Literal["px4", "ardupilot"],
    *,
    link: str | None = None,
    profile: str = "nominal",
    world: Path | None = None,
    speed: float = 1.0,
    seed: int = 1,
    system_id: int = 1,
    running: float = 0.0,
    param: Annotated[tuple[str, ...], Parameter(negative=())] = (),
) -> int:
    """Fly an embedded PX4 or ArduCopter alone, for other programs; Ctrl-C ends it.

    Parameters
    ----------
    autopilot
        px4 or ardupilot.
    link
        The vehicle's end of the link: udpout://127.0.0.1:14540 for px4, tcpin://127.0.0.1:5760
        for ardupilot without it.
    profile
        The vehicle and its air: a name, or a YAML file.
    world
        A world file, whose obstacles are physical.
    speed
        How many times real time its clock runs, as far as the machine can.
    seed
        Decides everything random in it.
    system_id
        Its MAVLink system id.
    running
        For how many seconds it has been on when its link opens: ArduCopter needs 42 s to be ready.
    param
        NAME=VALUE: a parameter that differs from the default; may be given several times.
    """
    try:
        address = _LINKS[autopilot] if link is None else link
        parse_link(address)
        load_profile(profile)
        settings = ProcessSettings(
            autopilot=autopilot,
            link=address,
            seed=seed,
            profile=profile,
            system_id=system_id,
            parameters=dict(_parameter(autopilot, each) for each in param),
            full_streams=True,
            speed=speed,
            running_s=running,
            boot_unix_us=time.time_ns() // 1000 - round(running * 1e6),
            end_with_parent=False,
        )
        settings = settings if world is None else _in_world(settings, world)
    except ValidationError as error:
        for fault in error.errors():
            option = str(fault["loc"][0]).removesuffix("_s").replace("_", "-")
            err(f"--{option}: {fault['msg']}")
        return _BAD_INPUT
    except (LinkAddressError, ProfileError, ValueError) as error:
        err(error)
        return _BAD_INPUT
    err(f"embedded {autopilot} at {address}, system id {system_id}; Ctrl-C ends it")
    return _UNAVAILABLE if run_process(settings) else 0


def _parameter(autopilot: Literal["px4", "ardupilot"], text: str) -> tuple[str, float]:
    """Return name and value of an embedded vehicle's parameter option."""
    name, equals, value = text.partition("=")
    known = known_parameters(autopilot)
    if name not in known:
        meant = closest(name, known)
        hint = f"; did you mean '{meant}'?" if meant else ""
        raise ValueError(f"the embedded {autopilot} has no parameter '{name}'{hint}")
    try:
        return name, float(value if equals else "none")
    except ValueError as error:
        raise ValueError(f"--param {text}: must be NAME=VALUE with a number") from error


def _in_world(settings: ProcessSettings, file: Path) -> ProcessSettings:
    """Return a vehicle's settings with a world's origin and obstacles. Raises BadInput."""
    document = load(file)
    frame = World.parse(document).frame
    return settings.model_copy(
        update={
            "latitude_deg": frame.latitude_deg,
            "longitude_deg": frame.longitude_deg,
            "altitude_m": frame.altitude_m,
            "surroundings": ContactWorldSettings(
                use="vehicles.embedded.physics.contact_world:from_argument",
                argument=as_argument(document, "real", "W"),
            ),
        }
    )
