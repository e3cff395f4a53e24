"""Setups of external I/O: sensor sources, calibration files."""

import os
from dataclasses import replace
from pathlib import Path

from wil_campaign.campaigns.schema import CameraPart, VehicleName, VehiclePart
from wil_campaign.campaigns.schema.calibration import CalibrationPart, read_calibration
from wil_campaign.campaigns.schema.sources import SourcedPart
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, SensorSetup, SourcedSetup
from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    KeyFaultError,
    Problem,
    load_document,
)
from wil_campaign.foundation.files.documents import Path as KeyPath
from wil_campaign.foundation.files.paths import path_exists
from wil_campaign.worlds.camera import CameraMount


def sensor_setups(
    file: Document, vehicle: VehicleName, part: VehiclePart, problems: list[Problem]
) -> tuple[SensorSetup, ...]:
    """Return a vehicle's sensor setups; problems of their external files are collected."""
    found: list[SensorSetup] = []
    for name, sensor in part.sensors.items():
        path = ("vehicles", vehicle, "sensors", name)
        outside = isinstance(sensor, CameraPart) and (sensor.source or sensor.calibration)
        if isinstance(sensor, CameraPart) and outside:
            camera = _camera(file, path, sensor, problems)
            found += [] if camera is None else [camera]
        elif isinstance(sensor, SourcedPart) and sensor.source is not None:
            try:
                found.append(_sourced(file, part, sensor, sensor.setup(name)))
            except KeyFaultError as error:
                found.append(sensor.setup(name))
                problems.append(file.problem((*path, *error.path), str(error)))
        else:
            found.append(sensor.setup(name))
    return tuple(found)


def _sourced(
    file: Document, vehicle: VehiclePart, part: SourcedPart, setup: SourcedSetup
) -> SensorSetup:
    if part.source is None:
        return setup
    message = part.sourced_from(vehicle.autopilot)
    try:
        source = part.source.setup(_folder(file), sensor=setup.name, message=message)
    except KeyFaultError as error:
        raise KeyFaultError(("source", *error.path), str(error)) from error
    return replace(setup, source=source)


def _camera(
    file: Document, path: KeyPath, part: CameraPart, problems: list[Problem]
) -> CameraSetup | None:
    """Return a camera's setup with external calibration and source; None when they are bad."""
    calibration = _calibration(file, path, part, problems)
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
        source = part.source.setup(_folder(file), latency_s=(latency_ms or 0.0) / 1000.0)
    except KeyFaultError as error:
        problems.append(file.problem((*path, "source", *error.path), str(error)))
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
    if not path_exists(file):
        message = f"there is no file '{part.calibration}' beside the campaign"
        problems.append(campaign.problem(at, message))
        return None
    name = os.path.normpath(Path(campaign.name).parent / part.calibration)
    try:
        found = read_calibration(load_document(file, name=name))
    except BadInput as error:
        problems += error.problems
        return None
    size = (found.camera.width_px, found.camera.height_px)
    if size != (part.width_px, part.height_px):
        message = f"is for {size[0]}x{size[1]}, but the camera has {part.width_px}x{part.height_px}"
        problems.append(campaign.problem(at, message))
        return None
    return found


def _folder(file: Document) -> Path:
    return file.path.parent
