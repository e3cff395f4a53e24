"""What is on board of the vehicle: its parameters, missions, fences, logs, GPS receiver."""

from collections.abc import Callable

from vehicles.autopilots.base import Autopilot, AutopilotName
from vehicles.driver.fence import Fences
from vehicles.driver.identity import Identity
from vehicles.driver.logs import Logs
from vehicles.driver.mission import Missions
from vehicles.driver.parameters import Parameters
from vehicles.driver.satellites import Satellites
from vehicles.driver.session import Session

_LOG_SUFFIX: dict[AutopilotName, str] = {"px4": ".ulg", "ardupilot": ".bin"}


class Onboard:
    """Parameters, missions, fences, logs and GPS of one vehicle; usable once it is identified.

    missions, logs: None for those that speak by the session.
    """

    def __init__(
        self,
        *,
        session: Session,
        circumstances: Callable[[], str],
        missions: Missions | None = None,
        logs: Logs | None = None,
    ) -> None:
        self.parameters = Parameters(session=session)
        self.missions = missions or Missions(session=session, circumstances=circumstances)
        self.fences = Fences(missions=self.missions)
        self.logs = logs or Logs(session=session)
        self.satellites = Satellites(session=session)

    def identified(self, autopilot: Autopilot, identity: Identity) -> None:
        """Take note of whose they are, and of how this autopilot does it."""
        self.parameters.use_bytewise(autopilot.parameters_bytewise)
        self.parameters.use_identity(f"{autopilot.name} {identity.system_id} {identity.uid}")
        self.missions.use_home_first(autopilot.name == "ardupilot")
        self.logs.use_suffix(_LOG_SUFFIX[autopilot.name])
