"""A desk without a campaign behind it, for tests of what comes to it."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.campaign_records import OperatorPlace
from wil_campaign.safety.guard.core.operator_command import OperatorCommand


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
    folder: Path,
    fleet: FakeFleet,
    *,
    said: list[str] | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> CampaignController:
    if said is not None:
        say = said.append
    return CampaignController(campaign="gate", folder=folder, total=4, fleet=fleet, say=say)


@contextmanager
def silent_place(name: str, folder: Path, path: Path) -> Iterator[OperatorPlace]:
    """Have an operator socket at a path that accepts commands and never replies to them."""
    with socket.socket(socket.AF_UNIX) as end:
        end.bind(str(path))
        end.listen()
        yield OperatorPlace(name, folder, path)
