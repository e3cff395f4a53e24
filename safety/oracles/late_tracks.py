"""Stretches that were judged before it was known where a flown object was in them; pure."""

from collections import deque
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.worlds.scene.track import AHEAD_S, RunHistory

_MOST = 1000
"""Stretches that are kept: of 20 s at 50 Hz, more than an actor may be silent."""


class LateStretch(NamedTuple):
    """A stretch between two poses that is to be judged again, against the object that was late."""

    name: str
    first: PoseSample
    last: PoseSample


class LateTracks:
    """Finds the stretches that were judged while a flown object was taken to rest.

    Its track goes on at its velocity for AHEAD_S after its last pose, and then it rests. Where it
    was silent for longer, or its poses come later than that, its next pose says where it was.
    events: of the world, with the tracks.
    """

    def __init__(self, events: Mapping[str, float]) -> None:
        self._tracks = events.tracks if isinstance(events, RunHistory) else {}
        self._known_s: dict[str, float] = {}
        self._judged: deque[tuple[PoseSample, PoseSample]] = deque(maxlen=_MOST)

    def add(self, first: PoseSample, last: PoseSample) -> None:
        """Add a stretch that is judged now, by what the tracks have."""
        if not self._tracks:
            return
        known = (track.last_s for track in self._tracks.values())
        certain_s = min((at_s for at_s in known if at_s is not None), default=last.t_s) + AHEAD_S
        while self._judged and self._judged[0][1].t_s <= certain_s:
            self._judged.popleft()
        self._judged.append((first, last))

    def due(self) -> Iterator[LateStretch]:
        """Yield the stretches to be judged again, by track, each once for each change of it."""
        for name, track in self._tracks.items():
            known_s, last_s = self._known_s.get(name), track.last_s
            if last_s is None or known_s == last_s:
                continue
            self._known_s[name] = last_s
            for first, last in self._judged:
                if known_s is not None and known_s + AHEAD_S < last.t_s:
                    yield LateStretch(name, first, last)
