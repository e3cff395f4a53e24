"""`wil-campaign vehicle`: an embedded vehicle alone in a process, at a link for any program."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from pydantic import ValidationError

from orchestrator.cli.standard_streams import err
from vehicles.embedded.process.embedded_process import run_process
from vehicles.embedded.process.standalone_settings import check_parameter, standalone_settings
from vehicles.embedded.profile import ProfileError
from vehicles.links.link_strings import LinkAddressError

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
        settings = standalone_settings(
            autopilot,
            address,
            profile=profile,
            world=world,
            speed=speed,
            seed=seed,
            system_id=system_id,
            running_s=running,
            parameters=dict(_parameter(autopilot, each) for each in param),
        )
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
    check_parameter(autopilot, name)
    try:
        return name, float(value if equals else "none")
    except ValueError as error:
        raise ValueError(f"--param {text}: must be NAME=VALUE with a number") from error
