"""What a campaign file may say: one module per part of the file.

A key stands here only when code acts on it; any other is an unknown key and refused.
"""

from campaigns.schema.autonomy import AutonomyPart
from campaigns.schema.campaign import (
    DEFAULT_CASE,
    MATRIX_KEYS,
    CampaignPart,
    GoalPart,
    Mode,
    PictureFormat,
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
    "Mode",
    "MountPart",
    "PictureFormat",
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
