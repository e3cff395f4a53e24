"""`wil-campaign vehicle`: flies one embedded vehicle in a process, for any MAVLink program."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from pydantic import ValidationError

from wil_campaign.foundation.files.documents import load_document
from wil_campaign.orchestrator.cli.standard_streams import write_stderr
from wil_campaign.plugins.python.standalone_settings import (
    check_parameter,
    standalone_settings,
)
from wil_campaign.plugins.standalone.vehicle_mocap import VehicleMocap
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.embedded.process.embedded_process import Companion, run_process
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings
from wil_campaign.vehicles.embedded.profile import ProfileError, load_profile
from wil_campaign.vehicles.faults import FaultTextError, parse_fault
from wil_campaign.vehicles.links.link_strings import LinkAddressError, parse_link
from wil_campaign.worlds.world_file.world import World

_BAD_INPUT, _UNAVAILABLE = 2, 3
_VIDEO = "127.0.0.1:5600"


def vehicle(
    autopilot: str,
    *,
    link: str | None = None,
    profile: str = "nominal",
    world: Path | None = None,
    speed: float = 1.0,
    seed: int = 1,
    system_id: int = 1,
    running: float = 0.0,
    camera: Annotated[bool, Parameter(negative=())] = False,
    video: str | None = None,
    mocap: str | None = None,
    param: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    fault: Annotated[tuple[str, ...], Parameter(negative=())] = (),
) -> int:
    """Fly an embedded PX4 or ArduCopter alone, for other programs; Ctrl-C ends it.

    Parameters
    ----------
    autopilot
        px4 or ardupilot.
    link
        The vehicle's end of the link; by default udpout://127.0.0.1:14540 for px4,
        tcpin://127.0.0.1:5760 for ardupilot.
    profile
        The vehicle and its air: a name, or a YAML file.
    world
        A world file, whose obstacles are physical.
    speed
        How many times real time its clock runs, as far as the machine can.
    seed
        Determines all random values of the vehicle.
    system_id
        Its MAVLink system id.
    running
        For how many seconds the vehicle has been on when its link opens: ArduCopter needs 42 s to
        be ready.
    camera
        Render a camera at its nose in the world of --world, send it by RTP as H.264, and announce
        it to ground stations as a MAVLink camera.
    video
        Where the camera's images go: HOST:PORT, by default 127.0.0.1:5600.
    mocap
        Send the vehicle's poses as motion capture, body `drone`, to HOST:PORT by UDP.
    param
        NAME=VALUE: a parameter that differs from the default; may be given several times.
    fault
        NAME@SECONDS: a fault and when it begins, as motor@12, mute@5+2 or "pose_source stop@8"; may
        be given several times. docs/vehicle.md lists all.
    """
    try:
        address = autopilot_named(autopilot).embedded_link if link is None else link
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
            faults=fault,
        )
        companions: list[Companion] = [] if mocap is None else [_mocap_of(mocap).attach]
        if camera:
            companions.append(_camera_of(settings, world, video))
        else:
            _check_no_camera(fault, video)
    except (LinkAddressError, ProfileError, ValueError) as error:
        _print_mistakes(error)
        return _BAD_INPUT
    shown = f", camera at {video or _VIDEO}" if camera else ""
    shown += f", motion capture at {mocap}" if mocap else ""
    write_stderr(f"embedded {autopilot} at {address}, system id {system_id}{shown}; Ctrl-C ends it")
    return _fly(settings, companions)


def _print_mistakes(error: Exception) -> None:
    """Print the faults of the command's options, a line for each."""
    match error:
        case ValidationError():
            for error_details in error.errors():
                option = str(error_details["loc"][0]).removesuffix("_s").replace("_", "-")
                write_stderr(f"--{option}: {error_details['msg']}")
        case FaultTextError():
            write_stderr(f"--fault {error}")
        case _:
            write_stderr(error)


def _fly(settings: ProcessSettings, companions: Sequence[Companion]) -> int:
    """Fly until the vehicle's process ends; return the exit code of the command."""
    from wil_campaign.plugins.outlets.image_delivery import DeliveryError  # noqa: PLC0415 - loads slowly

    try:
        return _UNAVAILABLE if run_process(settings, companions) else 0
    except DeliveryError as error:
        write_stderr(error)
        return _UNAVAILABLE


def _mocap_of(text: str) -> VehicleMocap:
    """Return the motion capture of an embedded vehicle. Raises ValueError."""
    try:
        return VehicleMocap(parse_link(f"udpout://{text}"))
    except LinkAddressError as error:
        raise ValueError(f"--mocap {text}: must be HOST:PORT, as in 127.0.0.1:5570") from error


def _camera_of(settings: ProcessSettings, world: Path | None, video: str | None) -> Companion:
    """Return the camera of an embedded vehicle. Raises ValueError, BadInput."""
    if world is None:
        raise ValueError("--camera: give --world FILE too: the camera shows that world")
    from wil_campaign.plugins.outlets.sdp import RtpAddress  # noqa: PLC0415 - loads slowly
    from wil_campaign.plugins.standalone.vehicle_camera import rtp_camera  # noqa: PLC0415 - loads slowly
    from wil_campaign.vehicles.cameras.camera_effects import CameraQuality  # noqa: PLC0415 - loads slowly

    try:
        address = RtpAddress.of(video or _VIDEO)
    except ValueError as error:
        raise ValueError(f"--video {error}") from error
    camera = rtp_camera(
        scene=World.parse(load_document(world)).scene("real", "W"),
        quality=CameraQuality.of_profile(load_profile(settings.profile).camera),
        address=address,
        seed=settings.seed,
    )
    write_stderr(
        "the camera renders its first image (after an installation this compiles, up to a minute)"
    )
    camera.warm_up()
    return camera.attach


def _check_no_camera(faults: tuple[str, ...], video: str | None) -> None:
    if video is not None:
        raise ValueError(f"--video {video}: there is no camera; give --camera")
    for text in faults:
        if parse_fault(text).name == "camera":
            raise ValueError(f"--fault {text}: there is no camera; give --camera")


def _parameter(autopilot: str, text: str) -> tuple[str, float]:
    """Return name and value of an embedded vehicle's parameter option."""
    name, equals, value = text.partition("=")
    check_parameter(autopilot, name)
    try:
        return name, float(value if equals else "none")
    except ValueError as error:
        raise ValueError(f"--param {text}: must be NAME=VALUE with a number") from error
