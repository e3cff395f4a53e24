"""Sleeping to a time of the run clock."""

import asyncio


async def sleep_until(t_s: float) -> None:
    """Sleep to a time of the run clock, exactly; at once when it is past."""
    loop = asyncio.get_running_loop()
    if t_s <= loop.time():
        return
    reached: asyncio.Future[None] = loop.create_future()
    timer = loop.call_at(t_s, _set_result, reached)
    try:
        await reached
    finally:
        timer.cancel()


def _set_result(reached: asyncio.Future[None]) -> None:
    if not reached.done():
        reached.set_result(None)
