"""Flights that must fail, judged by a simulator's ground truth with a seeded fault in it.

`python -m tests.faults.ground_truth FIRST COUNT FOLDER` prints one JSON object for each flight.
None may be a PASS, and nothing is exempt: of other sources the estimate alone stands beside it.
"""

import sys
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tests.faults.alterations import Kind
from tests.faults.signals import SignalFault, draw, fly_seeds

_OF_ALL: tuple[Kind, ...] = ("stop", "freeze", "delay", "bias", "jump", "nan", "duplicate")
POSSIBLE: Mapping[str, tuple[Kind, ...]] = {
    "ground truth": _OF_ALL,
    "places": ("freeze", "bias", "jump"),
    "position": ("stop", "freeze", "delay", "bias", "jump", "nan", "duplicate"),
}
"""What is faulty: the whole message, its places alone, or the estimate beside it."""
_OFTEN = ("ground truth", "ground truth", "places", "position")


def draw_truth(seed: int) -> SignalFault:
    """Return the fault of a seed: the flight of that seed, judged by its simulator."""
    rng = np.random.default_rng([seed, 37])
    base = draw(seed)
    signal = _OFTEN[int(rng.integers(len(_OFTEN)))]
    kinds = POSSIBLE[signal]
    return replace(
        base,
        judged_by="simulator",
        autopilot="ardupilot" if rng.random() < 0.5 else "px4",
        signal=signal,
        vehicle=base.subject,
        lone=True,
        alteration=replace(base.alteration, kind=kinds[int(rng.integers(len(kinds)))]),
    )


if __name__ == "__main__":
    fly_seeds(draw_truth, sys.argv[1:])
