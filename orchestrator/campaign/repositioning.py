"""Between runs on hardware: the campaign waits until a person confirms that the vehicle is back.

A run places the world relative to where the vehicle starts: after a flight to the other end of the
hall, the next world would reach through the wall.
"""

import asyncio
import contextlib
import sys
import termios
from collections.abc import Callable

from wil_campaign.orchestrator.operator.campaign_controller import (
    PERSON_AWAITED,
    CampaignController,
)
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_lines import RefusedLineError

WAIT_S = 1800.0
"""Enough to change a battery, and perhaps a propeller."""


class Repositioning:
    """Holds a campaign after each run for repositioning by a person, at most `wait_s`.

    vehicles: the vehicles to move, in words. say: shows the person a sentence. The campaign
    continues at Enter on its terminal, or by `wil-campaign resume` from anywhere. Enter does not
    release what an operator holds.
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

    def ask(self, elsewhere: str = "") -> None:
        """Hold the campaign and ask the person; do nothing if the campaign is stopped.

        elsewhere: in words, the start of the next run where it is another one.
        """
        if self._controller.stopped is not None:
            return
        with contextlib.suppress(RefusedLineError):
            self._controller.obey(OperatorCommand("hold", PERSON_AWAITED))
        terminal = sys.stdin.isatty() and self._controller.held_by == PERSON_AWAITED
        how = "press Enter, or " if terminal else ""
        where = f"to the start of the next run, {elsewhere}" if elsewhere else "back to its start"
        self._say(
            f"move {self._vehicles} {where}, check its battery, and step away; then {how}run: "
            "wil-campaign resume"
        )
        loop = asyncio.get_running_loop()
        self.end_wait()
        self._limit = loop.call_later(self._wait_s, self._abort_campaign)
        if terminal:
            # What was typed during the flight answers nothing.
            with contextlib.suppress(termios.error):
                termios.tcflush(sys.stdin, termios.TCIFLUSH)
            loop.add_reader(sys.stdin.fileno(), self._read_entry)
            self._listening = True

    def _read_entry(self) -> None:
        """Resume the campaign at Enter; the end of the input confirms nothing."""
        try:
            line = sys.stdin.readline()
        except OSError:  # the terminal hung up
            line = ""
        if not line.endswith("\n"):
            self._stop_listening()
            self._say("the input ended without Enter; to continue run: wil-campaign resume")
            return
        if (holder := self._controller.held_by) not in {"", PERSON_AWAITED}:
            self._say(f"held by {holder}; to continue run: wil-campaign resume")
            return
        self.end_wait()
        with contextlib.suppress(RefusedLineError):
            self._controller.obey(OperatorCommand("resume", "terminal"))

    def _abort_campaign(self) -> None:
        self.end_wait()
        if not self._controller.held or self._controller.stopped is not None:
            return
        self._say(f"nobody confirmed within {self._wait_s:g} s that {self._vehicles} is back")
        self._controller.obey(OperatorCommand("abort", PERSON_AWAITED))

    def end_wait(self) -> None:
        """End the wait for the person: the campaign is resumed or over."""
        if self._limit is not None:
            self._limit.cancel()
            self._limit = None
        self._stop_listening()

    def _stop_listening(self) -> None:
        if self._listening:
            self._listening = False
            asyncio.get_running_loop().remove_reader(sys.stdin.fileno())
