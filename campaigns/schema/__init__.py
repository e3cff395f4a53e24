"""The schema of campaign files: one module per part of the file.

A key is listed only when code acts on it; any other key is refused as unknown.
"""

from wil_campaign.campaigns.schema.autonomy import AutonomyPart
from wil_campaign.campaigns.schema.campaign import (
    DEFAULT_CASE,
    CampaignPart,
    GoalPart,
    ImageFormat,
    Mode,
    PositionPart,
    RecordPart,
    SyncPart,
    campaign_model,
    matrix_keys,
)
from wil_campaign.campaigns.schema.fence import GeofencePart
from wil_campaign.campaigns.schema.preflight import PreflightPart
from wil_campaign.campaigns.schema.sensors import CameraPart, SensorPart
from wil_campaign.campaigns.schema.vehicles import (
    VEHICLES,
    StartPart,
    VehicleName,
    VehiclePart,
    VehiclesPart,
)

__all__ = [
    "DEFAULT_CASE",
    "VEHICLES",
    "AutonomyPart",
    "CameraPart",
    "CampaignPart",
    "GeofencePart",
    "GoalPart",
    "ImageFormat",
    "Mode",
    "PositionPart",
    "PreflightPart",
    "RecordPart",
    "SensorPart",
    "StartPart",
    "SyncPart",
    "VehicleName",
    "VehiclePart",
    "VehiclesPart",
    "campaign_model",
    "matrix_keys",
]
