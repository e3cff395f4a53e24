"""Opens the operator channels of a campaign, its socket and those of plugins, while it flies."""

from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from types import MappingProxyType

from wil_campaign.hooks import operator_channels
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.campaign_records import (
    CampaignRecord,
    OperatorPlace,
    operator_places,
)
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.safety.guard.operator.operator_socket import (
    POINTER,
    OperatorSocket,
)

Connect = Callable[[CampaignController, object], AbstractAsyncContextManager[None]]
NO_SETUPS: Mapping[str, object] = MappingProxyType({})


@asynccontextmanager
async def open_operator_channels(
    controller: CampaignController, setups: Mapping[str, object] = NO_SETUPS
) -> AsyncIterator[None]:
    """Open the campaign controller's operator channels: its socket, and then those of plugins.

    setups: by the names of these channels. Registers the campaign as in flight on this machine.
    Raises OperatingError.
    """
    controller.guards = lambda: _guards(controller)
    async with AsyncExitStack() as stack:
        stack.callback(_close_log, controller)
        try:
            await _serve_socket(stack, controller)
        except OSError as error:
            raise OperatingError(f"the operator socket cannot be opened: {error}") from error
        for name, setup in setups.items():
            connect: Connect = load_plugin_object(plugin_additions(operator_channels)[name].open)
            await stack.enter_async_context(connect(controller, setup))
        yield


def _close_log(controller: CampaignController) -> None:
    """Have a slow disk take the last lines of the operator log; say how many are lost."""
    if lost := controller.log.close():
        controller.warn(
            f"operator.jsonl: {lost} of its lines were not written, and with them commands that "
            f"operators gave; check the disk of {controller.folder}"
        )


async def _serve_socket(stack: AsyncExitStack, controller: CampaignController) -> None:
    record = stack.enter_context(CampaignRecord(name=controller.campaign, folder=controller.folder))
    for text in record.passed_over:
        controller.warn(text)
    await stack.enter_async_context(
        OperatorSocket(
            path=record.socket,
            obey=controller.obey,
            status=controller.status,
            refused=controller.log.refused,
            pointer=controller.folder / POINTER,
        )
    )


def _guards(controller: CampaignController) -> Sequence[OperatorPlace]:
    try:
        return operator_places().beneath(controller.folder).guards
    except OSError:
        # The runs get the abort by their pipes as well.
        return ()
