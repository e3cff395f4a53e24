"""Between repetitions on hardware: nothing takes off before a person has put it back and says so.

Where a vehicle stands is its start: one that flew to the other end of the hall would take the
whole world with it, through the wall.
"""

import asyncio
import contextlib
import sys
from collections.abc import Callable

from orchestrator.operator.campaign_controller import CampaignController
from safety.guard.core.operator_command import OperatorCommand
from safety.guard.operator.operator_lines import RefusedLineError

WAIT_S = 1800.0
"""A battery is changed in between, and perhaps a propeller."""
_WHO = "repositioning"


class Repositioning:
    """Holds a campaign after each run for repositioning by a person, at most `wait_s`.

    vehicles: what has to be put back, in words. say: for the person. On a terminal Enter lets it
    go on; from everywhere `wil-campaign resume` does.
    """

    def __init__(
        self,
        *,
        vehicles: str,
        controller: CampaignController,
        say: Callable[[str], None],
        wait_s: float = WAIT_S,
    ) -> None:
        self._vehicles = vehicles
        self._controller = controller
        self._say = say
        self._wait_s = wait_s
        self._limit: asyncio.TimerHandle | None = None
        self._listening = False

    def ask(self) -> None:
        """Hold for repositioning, and say what to do; nothing when the campaign ends anyway."""
        if self._controller.stopped is not None:
            return
        with contextlib.suppress(RefusedLineError):
            self._controller.obey(OperatorCommand("hold", _WHO))
        terminal = sys.stdin.isatty()
        how = "press Enter, or " if terminal else ""
        self._say(
            f"move {self._vehicles} back to its start, check its battery, and step away; then "
            f"{how}say: wil-campaign resume"
        )
        loop = asyncio.get_running_loop()
        self._stop_waiting()
        self._limit = loop.call_later(self._wait_s, self._give_up)
        if terminal:
            loop.add_reader(sys.stdin.fileno(), self._read_entry)
            self._listening = True

    def gone_on(self) -> None:
        """End the wait for repositioning: somebody resumed, or all is over."""
        self._stop_waiting()

    def _read_entry(self) -> None:
        sys.stdin.readline()
        self._stop_waiting()
        with contextlib.suppress(RefusedLineError):
            self._controller.obey(OperatorCommand("resume", "terminal"))

    def _give_up(self) -> None:
        self._stop_waiting()
        if not self._controller.held or self._controller.stopped is not None:
            return
        self._say(f"nobody confirmed that {self._vehicles} is back within {self._wait_s:g} s")
        self._controller.obey(OperatorCommand("abort", _WHO))

    def _stop_waiting(self) -> None:
        if self._limit is not None:
            self._limit.cancel()
            self._limit = None
        if self._listening:
            self._listening = False
            asyncio.get_running_loop().remove_reader(sys.stdin.fileno())
