"""Sends our heartbeats to the vehicle, and detects the loss and return of the link."""

import asyncio
from collections.abc import Callable

from wil_campaign.vehicles.autopilots.autopilot import own_heartbeat
from wil_campaign.vehicles.driver.session.repeater import Repeater
from wil_campaign.vehicles.driver.session.session import MavlinkSession

_HEARTBEAT_PERIOD_S = 1.0
_WATCH_PERIOD_S = 0.1


class LinkMonitor:
    """Monitors the link: sends a heartbeat each second, and detects the vehicle's silence.

    on_lost, on_back: called once each time, with the run clock's time and for how long nothing
    was received. silence_s: how long nothing is received until the link counts as lost.
    """

    def __init__(
        self,
        *,
        session: MavlinkSession,
        silence_s: float,
        on_lost: Callable[[float, float], None],
        on_back: Callable[[float, float], None],
    ) -> None:
        self._session = session
        self._silence_s = silence_s
        self._on_lost = on_lost
        self._on_back = on_back
        self._is_lost = False
        self._heartbeat = Repeater(period_s=_HEARTBEAT_PERIOD_S, action=self._send_heartbeat)
        self._watch = Repeater(period_s=_WATCH_PERIOD_S, action=self._check_silence)
        session.on_arrival = self._on_frame

    def start(self) -> None:
        """Start the link monitor's heartbeats."""
        self._heartbeat.start()

    def watch(self) -> None:
        """Start to monitor the link: from now on the vehicle should be received."""
        self._watch.start()

    def stop(self) -> None:
        """Stop heartbeats and link monitoring."""
        self._heartbeat.stop()
        self._watch.stop()

    def silence(self) -> str:
        """Return in words how long the link has been silent; empty when short."""
        silent_s = self._silent_for_s()
        return f"nothing received for {silent_s:.1f} s" if silent_s > self._silence_s else ""

    def _silent_for_s(self) -> float:
        last_s = self._session.last_received_s
        return 0.0 if last_s is None else asyncio.get_running_loop().time() - last_s

    def _send_heartbeat(self) -> None:
        self._session.send(own_heartbeat())

    def _check_silence(self) -> None:
        silent_s = self._silent_for_s()
        if not self._is_lost and silent_s > self._silence_s:
            self._is_lost = True
            self._on_lost(asyncio.get_running_loop().time(), silent_s)

    def _on_frame(self, t_s: float) -> None:
        if self._is_lost:
            self._is_lost = False
            last_s = self._session.last_received_s
            self._on_back(t_s, 0.0 if last_s is None else t_s - last_s)
