"""Access to the vehicle's onboard data: parameters, missions, fences, logs, GPS receiver."""

from collections.abc import Callable

from wil_campaign.vehicles.autopilots.autopilot import Autopilot
from wil_campaign.vehicles.driver.onboard.fence_protocol import FenceProtocol
from wil_campaign.vehicles.driver.onboard.gps_receiver import GpsReceiver
from wil_campaign.vehicles.driver.onboard.mission_protocol import MissionProtocol
from wil_campaign.vehicles.driver.onboard.parameters import OnboardParameters
from wil_campaign.vehicles.driver.onboard.vehicle_logs import VehicleLogs
from wil_campaign.vehicles.driver.session.identity import VehicleIdentity
from wil_campaign.vehicles.driver.session.session import MavlinkSession


class Onboard:
    """The onboard data of one identified vehicle: parameters, missions, fences, logs, GPS.

    missions, logs: None for those that use the session.
    """

    def __init__(
        self,
        *,
        session: MavlinkSession,
        circumstances: Callable[[], str],
        missions: MissionProtocol | None = None,
        logs: VehicleLogs | None = None,
    ) -> None:
        self.parameters = OnboardParameters(session=session)
        self.missions = missions or MissionProtocol(session=session, circumstances=circumstances)
        self.fences = FenceProtocol(missions=self.missions)
        self.logs = logs or VehicleLogs(session=session)
        self.gps_receiver = GpsReceiver(session=session)

    def identified(self, autopilot: Autopilot, identity: VehicleIdentity) -> None:
        """Set the vehicle's identity, and how its autopilot stores onboard data."""
        self.parameters.use_bytewise(autopilot.parameters_bytewise)
        self.parameters.use_identity(f"{autopilot.name} {identity.system_id} {identity.uid}")
        self.missions.use_home_first(autopilot.missions_begin_at_home)
        # PX4 numbers its logs as readdir() returns their files (mavlink_log_handler.cpp).
        self.logs.use_format(
            autopilot.log_suffix, numbered_in_order=autopilot.logs_numbered_in_order
        )
