"""Setups of external I/O: sensor sources, calibration files, deliveries and external programs."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

from campaigns.schema import CameraPart, CampaignPart, VehicleName, VehiclePart
from campaigns.schema.calibration import CalibrationPart, read_calibration
from campaigns.schema.sources import SourcedPart
from campaigns.values.external_setups import ExternalSetup
from campaigns.values.sensor_setups import CameraSetup, SensorSetup, SourcedSetup
from worlds.camera import CameraMount
from worlds.files.documents import BadInput, Document, KeyFaultError, Problem, load
from worlds.files.documents import Path as KeyPath
from worlds.files.paths import exists, is_file


def sensor_setups(
    campaign: Document, vehicle: VehicleName, part: VehiclePart, problems: list[Problem]
) -> tuple[SensorSetup, ...]:
    """Return a vehicle's sensor setups; problems of their external files are collected."""
    found: list[SensorSetup] = []
    for name, one in part.sensors.items():
        path = ("vehicles", vehicle, "sensors", name)
        outside = isinstance(one, CameraPart) and (one.source or one.calibration)
        if isinstance(one, CameraPart) and outside:
            camera = _camera(campaign, path, one, problems)
            found += [] if camera is None else [camera]
        elif isinstance(one, SourcedPart) and one.source is not None:
            try:
                found.append(_sourced(campaign, part, one, one.setup(name)))
            except KeyFaultError as error:
                found.append(one.setup(name))
                problems.append(campaign.problem((*path, *error.path), str(error)))
        else:
            found.append(one.setup(name))
    return tuple(found)


def _sourced(
    campaign: Document, vehicle: VehiclePart, part: SourcedPart, setup: SourcedSetup
) -> SensorSetup:
    """Return the setup of a sensor with external readings. Raises KeyFaultError."""
    if part.source is None:
        return setup
    message = part.sourced_from(vehicle.autopilot)
    try:
        source = part.source.setup(_folder(campaign), sensor=setup.name, message=message)
    except KeyFaultError as error:
        raise KeyFaultError(("source", *error.path), str(error)) from error
    return replace(setup, source=source)


def _camera(
    campaign: Document, path: KeyPath, part: CameraPart, problems: list[Problem]
) -> CameraSetup | None:
    """Return a camera's setup with external calibration and source; None when they are bad."""
    calibration = _calibration(campaign, path, part, problems)
    if part.calibration is not None and calibration is None:
        return None
    intrinsics = part.intrinsics() if calibration is None else calibration.camera.intrinsics()
    mount = part.camera_mount()
    measured = None if calibration is None else calibration.mount
    if measured is not None and "mount" not in part.model_fields_set:
        mount = CameraMount(measured.pose(), part.stabilized)
    setup = CameraSetup(
        name=str(path[-1]), rate_hz=part.rate_hz, intrinsics=intrinsics, mount=mount
    )
    if part.source is None:
        return setup
    latency_ms = None if calibration is None else calibration.latency_ms
    try:
        source = part.source.setup(_folder(campaign), latency_s=(latency_ms or 0.0) / 1000.0)
    except KeyFaultError as error:
        problems.append(campaign.problem((*path, "source", *error.path), str(error)))
        return setup
    return replace(setup, source=source)


def _calibration(
    campaign: Document, path: KeyPath, part: CameraPart, problems: list[Problem]
) -> CalibrationPart | None:
    """Return the calibration file that a camera names; None without one, or with a bad one."""
    if part.calibration is None:
        return None
    at = (*path, "calibration")
    file = _folder(campaign) / part.calibration
    if not exists(file):
        message = f"there is no file '{part.calibration}' beside the campaign"
        problems.append(campaign.problem(at, message))
        return None
    name = os.path.normpath(Path(campaign.name).parent / part.calibration)
    try:
        found = read_calibration(load(file, name=name))
    except BadInput as error:
        problems += error.problems
        return None
    size = (found.camera.width_px, found.camera.height_px)
    if size != (part.width_px, part.height_px):
        message = f"is for {size[0]}x{size[1]}, but the camera has {part.width_px}x{part.height_px}"
        problems.append(campaign.problem(at, message))
        return None
    return found


def external_setup(
    campaign: Document, part: CampaignPart, problems: list[Problem]
) -> ExternalSetup:
    """Return the external deliveries and injections of a case.

    A delivery without a camera's name is a problem where there are several cameras.
    """
    cameras = sorted(
        {
            name
            for vehicle in (part.vehicles.real, part.vehicles.twin)
            for name, sensor in (vehicle.sensors.items() if vehicle is not None else ())
            if isinstance(sensor, CameraPart)
        }
    )
    outlets = []
    for index, one in enumerate(part.deliver):
        if one.sensor is None and len(cameras) != 1:
            there = ", ".join(cameras) or "none"
            message = f"name the camera by `sensor` (there are: {there})"
            problems.append(campaign.problem(("deliver", index), message))
        outlets.append(one.outlet(cameras[0] if cameras else ""))
    return ExternalSetup(
        outlets=tuple(outlets),
        injections=part.inject.setups(),
        ground_station=part.ground_station,
    )


def program_problems(campaign: Document, command: tuple[str, ...], folder: Path) -> list[Problem]:
    """Return the problem of an external program that is missing or not executable."""
    program = command[0]
    found = folder / program if "/" in program else shutil.which(program)
    path = ("autonomy", "program", 0)
    if found is None:
        return [campaign.problem(path, f"there is no program '{program}' in PATH")]
    if not is_file(Path(found)):
        return [campaign.problem(path, f"there is no file '{program}' beside the campaign")]
    if not os.access(found, os.X_OK):
        message = f"'{program}' is not executable: chmod +x it, or name its interpreter before it"
        return [campaign.problem(path, message)]
    return []


def _folder(campaign: Document) -> Path:
    """Return the campaign's folder, to which external files are relative."""
    return campaign.path.parent
