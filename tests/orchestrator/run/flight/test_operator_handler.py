"""How an operator's command reaches the guard in flight."""

import asyncio
from contextlib import suppress
from typing import Any

from wil_campaign.orchestrator.run.flight.operator_handler import OperatorHandler
from wil_campaign.safety.guard.core.commands import OperatorAction
from wil_campaign.safety.guard.core.operator_command import OperatorCommand


async def test_a_command_is_with_the_guard_before_it_is_recorded() -> None:
    done: list[str] = []
    commands = [OperatorCommand("abort", "anna"), OperatorCommand("hold", "anna")]

    class Stubs:
        def poll(self) -> OperatorCommand | None:
            return commands.pop() if commands else None

        def send(self, operate: OperatorAction) -> None:
            done.append(f"{operate.command.kind} to the guard")

    stubs: Any = Stubs()
    handler = OperatorHandler(
        inbox=stubs,
        guard=stubs,
        fence_changes=stubs,
        record=lambda command: done.append(f"{command.kind} recorded"),
        acknowledge=lambda command: done.append(f"{command.kind} acknowledged"),
    )
    with suppress(TimeoutError):
        async with asyncio.timeout(0.01):
            await handler.run(lambda: None)
    assert done == [
        f"{kind} {what}"
        for kind in ("hold", "abort")
        for what in ("to the guard", "recorded", "acknowledged")
    ]
