"""One vehicle on two links is refused: beside itself it would keep every distance."""

from types import SimpleNamespace
from typing import Any

import pytest

from tests.orchestrator.conftest import BRIEF, Fly
from wil_campaign.orchestrator.run.stages.distinct_vehicles import require_distinct_vehicles
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.state.run_state import FlightError, RunState


def contexts(*uids: str) -> Any:
    names = ("real", "twin", "intruder")
    boards = (SimpleNamespace(simulation=False, uid=uid) for uid in uids)
    driven = (SimpleNamespace(identity=board) for board in boards)
    return [
        SimpleNamespace(name=name, driver=driver)
        for name, driver in zip(names, driven, strict=False)
    ]


@pytest.mark.parametrize(
    ("uids", "same"),
    [(("3132", "3132"), "real and twin"), (("3132", "77", "3132"), "real and intruder")],
)
def test_one_board_on_two_links_is_refused(uids: tuple[str, ...], same: str) -> None:
    with pytest.raises(FlightError, match=f"{same} are the same vehicle.*uid 3132"):
        require_distinct_vehicles(contexts(*uids))


def test_two_boards_on_two_links_are_accepted() -> None:
    require_distinct_vehicles(contexts("3132", "77", "78"))


def test_a_pair_that_is_one_vehicle_never_arms(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Embedded vehicles share a uid, and are told apart for they have no board."""

    def as_one_board(pair: VehiclePair, _: RunState) -> None:
        real, twin = (context.driver for context in pair.contexts)
        one = SimpleNamespace(simulation=False, uid="3132")
        for driver in (real, twin):
            monkeypatch.setattr(type(driver), "identity", one)

    result, _ = fly_run("gate", "large", "wil", sets=BRIEF, disturb=as_one_board)
    assert result.verdict == "ERROR"
    assert "are the same vehicle" in result.reason
    assert result.duration_s is None
