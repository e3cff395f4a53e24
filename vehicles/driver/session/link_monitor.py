"""Our heartbeats to the vehicle, and the watch over its silence."""

import asyncio
from collections.abc import Callable

from vehicles.autopilots.autopilot import own_heartbeat
from vehicles.driver.session.repeater import Repeater
from vehicles.driver.session.session import Session

_HEARTBEAT_PERIOD_S = 1.0
_WATCH_PERIOD_S = 0.1


class LinkMonitor:
    """Monitors the link: sends a heartbeat each second, and notices the vehicle's silence.

    on_lost, on_back: called once each time, with the run clock's time and for how long nothing
    was heard. silence_s: how long nothing must come to count as lost.
    """

    def __init__(
        self,
        *,
        session: Session,
        silence_s: float,
        on_lost: Callable[[float, float], None],
        on_back: Callable[[float, float], None],
    ) -> None:
        self._session = session
        self._silence_s = silence_s
        self._on_lost = on_lost
        self._on_back = on_back
        self._lost = False
        self._heartbeat = Repeater(period_s=_HEARTBEAT_PERIOD_S, action=self._send)
        self._watch = Repeater(period_s=_WATCH_PERIOD_S, action=self._look)
        session.on_arrival = self._on_frame

    def start(self) -> None:
        """Start the link monitor's heartbeats."""
        self._heartbeat.start()

    def watch(self) -> None:
        """Start to monitor the link: from now on the vehicle is expected to be received."""
        self._watch.start()

    def stop(self) -> None:
        """Stop heartbeats and link monitoring."""
        self._heartbeat.stop()
        self._watch.stop()

    def silence(self) -> str:
        """Return in words how long the link has been silent; empty when short."""
        silent_s = self._silent_s()
        return f"nothing heard for {silent_s:.1f} s" if silent_s > self._silence_s else ""

    def _silent_s(self) -> float:
        last_s = self._session.last_heard_s
        return 0.0 if last_s is None else asyncio.get_running_loop().time() - last_s

    def _send(self) -> None:
        self._session.send(own_heartbeat())

    def _look(self) -> None:
        silent_s = self._silent_s()
        if not self._lost and silent_s > self._silence_s:
            self._lost = True
            self._on_lost(asyncio.get_running_loop().time(), silent_s)

    def _on_frame(self, t_s: float) -> None:
        if self._lost:
            self._lost = False
            last_s = self._session.last_heard_s
            self._on_back(t_s, 0.0 if last_s is None else t_s - last_s)
