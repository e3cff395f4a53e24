"""A desk without a campaign behind it, for tests of what comes to it."""

from pathlib import Path

from orchestrator.operator.campaign_controller import CampaignController
from safety.guard.core.operator_command import OperatorCommand


class FakeFleet:
    """Remembers what it was told; `flying` runs are in flight."""

    def __init__(self, flying: int = 1) -> None:
        self.flying = flying
        self.told: list[OperatorCommand] = []
        self.aborted: list[OperatorCommand] = []
        self.going = True

    def abort(self, command: OperatorCommand) -> None:
        self.aborted.append(command)
        self.going = True

    def pass_on(self, command: OperatorCommand) -> int:
        self.told.append(command)
        return self.flying

    def pause(self) -> None:
        self.going = False

    def go_on(self) -> None:
        self.going = True


def make_controller(
    folder: Path, fleet: FakeFleet, *, said: list[str] | None = None
) -> CampaignController:
    say = (lambda _: None) if said is None else said.append
    return CampaignController(campaign="gate", folder=folder, total=4, fleet=fleet, say=say)
