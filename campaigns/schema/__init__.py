"""The schema of campaign files: one module per part of the file.

A key is listed only when code acts on it; any other key is refused as unknown.
"""

from campaigns.schema.autonomy import AutonomyPart
from campaigns.schema.campaign import (
    DEFAULT_CASE,
    MATRIX_KEYS,
    CampaignPart,
    GoalPart,
    ImageFormat,
    Mode,
    PositionPart,
    RecordPart,
    SyncPart,
)
from campaigns.schema.fence import GeofencePart
from campaigns.schema.preflight import PreflightPart
from campaigns.schema.sensors import CameraPart, MountPart, SensorPart
from campaigns.schema.vehicles import VEHICLES, StartPart, VehicleName, VehiclePart, VehiclesPart

__all__ = [
    "DEFAULT_CASE",
    "MATRIX_KEYS",
    "VEHICLES",
    "AutonomyPart",
    "CameraPart",
    "CampaignPart",
    "GeofencePart",
    "GoalPart",
    "ImageFormat",
    "Mode",
    "MountPart",
    "PositionPart",
    "PreflightPart",
    "RecordPart",
    "SensorPart",
    "StartPart",
    "SyncPart",
    "VehicleName",
    "VehiclePart",
    "VehiclesPart",
]
