"""A download of missions, fences or rally points as PX4 keeps it (mavlink_mission.cpp).

PX4 sends items after a list was asked for, in their order, and takes nothing else until the client
acknowledges the end, or is silent for 5 s.
"""

Peer = tuple[int, int]
"""A client: system, component."""


class MissionDownload:
    """A download under way: who reads which list, and how far it is."""

    def __init__(self, *, kind: int, count: int, peer: Peer, t_s: float) -> None:
        self.kind = kind
        self.peer = peer
        self.last_received_s = t_s
        self._count = count
        self._sent = 0

    def may_restart(self, kind: int, peer: Peer) -> bool:
        """Return whether a client may ask for a list now: the same again, or after the end."""
        return self._sent == self._count or (self.kind, self.peer) == (kind, peer)

    def takes(self, seq: int) -> bool:
        """Return whether an item is the next one, or the last one again; count it as sent."""
        if seq == self._sent < self._count:
            self._sent += 1
            return True
        return seq == self._sent - 1
