"""What a run changed on a vehicle is restored, and every failure of it is told."""

from types import TracebackType

import pytest

from wil_campaign.orchestrator.run.vehicles.restoration import Restoration
from wil_campaign.vehicles.driver.onboard.mission_protocol import MissionError
from wil_campaign.vehicles.errors import ParameterError, VehicleError


class Failing:
    """A change that cannot be restored."""

    def __init__(self, error: VehicleError) -> None:
        self._error = error

    async def __aenter__(self) -> object:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        raise self._error

    def leave(self) -> bool:
        return True


async def test_no_failure_of_a_restoration_is_hidden() -> None:
    noted = MissionError("the backup is left; remove it")
    noted.add_note("CEILING stays 12")
    restoration = Restoration()
    await restoration.enter(Failing(ParameterError("RADIUS stays 20")))
    await restoration.enter(Failing(noted))
    said = "^the backup is left; remove it; CEILING stays 12; RADIUS stays 20$"
    with pytest.raises(VehicleError, match=said):
        await restoration.restore()
