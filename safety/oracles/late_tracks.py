"""Stretches that are judged once it is known where a flown object was in them; pure."""

import math
from collections import defaultdict, deque
from collections.abc import Iterator, Mapping
from functools import partial
from typing import NamedTuple

from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.worlds.scene.track import AHEAD_S, RunHistory

_MOST = 1000
"""Stretches that wait: of 20 s at 50 Hz, more than an actor may be silent."""
_RESTS_S = 3.0
"""An object that is silent for longer is at rest: in flight no actor may be, but a landed one."""
_NONE: frozenset[str] = frozenset()


class LateStretch(NamedTuple):
    """A stretch between two poses that is to be judged now, against the object that was late."""

    name: str
    first: PoseSample
    last: PoseSample


class LateTracks:
    """Holds the stretches of which it is not known yet where a flown object is in them.

    Its track goes on at its velocity for AHEAD_S after its last pose. Where it is silent for
    longer, or its poses come later than that, its next pose says where it was; without one for
    three seconds it is where it was last. events: of the world, with the tracks.
    """

    def __init__(self, events: Mapping[str, float]) -> None:
        self._tracks = events.tracks if isinstance(events, RunHistory) else {}
        self._now_s = 0.0
        self._waiting: defaultdict[str, deque[tuple[PoseSample, PoseSample]]] = defaultdict(
            partial(deque, maxlen=_MOST)
        )

    def add(self, first: PoseSample, last: PoseSample) -> frozenset[str]:
        """Take a stretch that is judged now; return the objects that it waits for."""
        if not self._tracks:
            return _NONE
        self._now_s = last.t_s
        late = frozenset(
            name
            for name, track in self._tracks.items()
            if track.last_s is not None and AHEAD_S < last.t_s - track.last_s <= _RESTS_S
        )
        for name in late:
            self._waiting[name].append((first, last))
        return late

    def due(self) -> Iterator[LateStretch]:
        """Yield the stretches that need not wait any more, those of one object in order."""
        for name, waiting in self._waiting.items():
            last_s = self._tracks[name].last_s or 0.0
            known_s = math.inf if self._now_s - last_s > _RESTS_S else last_s + AHEAD_S
            while waiting and waiting[0][1].t_s <= known_s:
                yield LateStretch(name, *waiting.popleft())
