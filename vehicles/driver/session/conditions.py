"""Waits for conditions on the vehicle's state to become true."""

import asyncio
from collections.abc import Callable


class ConditionWaiter:
    """Wakes tasks that wait for a condition whenever something changes."""

    def __init__(self) -> None:
        self._failure: Exception | None = None
        self._waiting: list[tuple[Callable[[], bool], asyncio.Future[None]]] = []

    def notify(self) -> None:
        """Evaluate the awaited conditions again."""
        for condition, future in self._waiting:
            if not future.done() and condition():
                future.set_result(None)

    def fail(self, error: Exception) -> None:
        """Raise an error in all present and later waits."""
        self._failure = error
        for _, future in self._waiting:
            if not future.done():
                future.set_exception(error)

    async def until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for the condition; return whether it came true within `timeout_s`.

        Raises the error that was passed to `fail`.
        """
        if self._failure is not None:
            raise self._failure
        if condition():
            return True
        future = asyncio.get_running_loop().create_future()
        entry = (condition, future)
        self._waiting.append(entry)
        try:
            async with asyncio.timeout(timeout_s):
                await future
        except TimeoutError:
            return False
        finally:
            self._waiting.remove(entry)
        return True
