"""Opens the ways in which an operator reaches a campaign, for as long as it flies."""

from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager

from orchestrator.operating.desk import Desk
from orchestrator.operating.records import CampaignRecord, Place, places
from safety.guard.operator_socket import POINTER, OperatorSocket


class OperatingError(Exception):
    """A way for operators that the campaign asks for cannot be had; says which and why."""


@asynccontextmanager
async def operating(desk: Desk) -> AsyncIterator[None]:
    """Have the desk reached by its socket, and say on this machine that the campaign flies.

    Raises OperatingError.
    """
    desk.guards = lambda: _guards(desk)
    async with AsyncExitStack() as stack:
        try:
            await _listen(stack, desk)
        except OSError as error:
            raise OperatingError(f"no socket for operators can be had: {error}") from error
        yield


async def _listen(stack: AsyncExitStack, desk: Desk) -> None:
    record = stack.enter_context(CampaignRecord(name=desk.campaign, folder=desk.folder))
    await stack.enter_async_context(
        OperatorSocket(
            path=record.socket,
            obey=desk.obey_line,
            status=desk.status,
            refused=desk.log.refused,
            pointer=desk.folder / POINTER,
        )
    )


def _guards(desk: Desk) -> Sequence[Place]:
    try:
        return places().beneath(desk.folder).guards
    except OSError:
        # Without the folder of records the runs are told by their pipes still.
        return ()
