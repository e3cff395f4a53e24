"""Which fault a seed stands for, in virtual time."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

CAMPAIGNS = {"gate": (15.05, 22.0, 27.0), "gate-ardupilot": (48.4, 54.0, 60.0)}
"""When the goal is given, done, and all is over in an undisturbed run, about, in seconds."""
VICTIMS = (
    *("real", "twin", "guard", "orchestrator", "stages", "judging", "trajectory", "operator"),
    *("autonomy", "source", "mixing", "any task"),
)
"""Who is killed, or stopped for a while."""
TROUBLES = (
    *("dark real", "dark twin", "dark both", "garbage", "foreign", "replayed", "flood", "forged"),
    *("cutting program", "disk full", "folder read-only", "clock jump"),
)
"""What else goes wrong. foreign: frames of another system. forged: unsigned where signed."""
WHILE_FLOWN = frozenset({"source", "mixing", "autonomy"})
"""Victims that are needed for a PASS until the goal is done; the others until both landed."""
_STOPPED_EVERY = 3
"""Of every so many rounds through the victims one stops them instead of killing them."""
Kind = Literal["kill", "stop", "trouble"]


@dataclass(frozen=True, slots=True)
class Fault:
    """What happens: in which campaign, to whom, when; for_s: for how long, inf for good."""

    seed: int
    campaign: str
    kind: Kind
    victim: str
    at_s: float
    for_s: float = float("inf")


def draw_kill(seed: int) -> Fault:
    """Return the fault of a seed: who dies, or is stopped, and when."""
    rng = np.random.default_rng([seed, 20])
    turn = seed // len(VICTIMS)
    campaign, victim = list(CAMPAIGNS)[turn % len(CAMPAIGNS)], VICTIMS[seed % len(VICTIMS)]
    at_s = _moment(rng, campaign, victim)
    if turn // len(CAMPAIGNS) % _STOPPED_EVERY != _STOPPED_EVERY - 1:
        return Fault(seed, campaign, "kill", victim, at_s)
    return Fault(seed, campaign, "stop", victim, at_s, _duration(rng, 0.3, 15.0))


def draw_trouble(seed: int) -> Fault:
    """Return the trouble of a seed."""
    rng = np.random.default_rng([seed, 23])
    turn = seed // len(TROUBLES)
    campaign, victim = list(CAMPAIGNS)[turn % len(CAMPAIGNS)], TROUBLES[seed % len(TROUBLES)]
    at_s = _moment(rng, campaign, victim)
    return Fault(seed, campaign, "trouble", victim, at_s, _duration(rng, 0.2, 8.0))


def _moment(rng: np.random.Generator, campaign: str, victim: str) -> float:
    goal_s, done_s, over_s = CAMPAIGNS[campaign]
    begins_s, ends_s = (goal_s, done_s) if victim in WHILE_FLOWN else (0.5, over_s)
    return round(float(rng.uniform(begins_s, ends_s)), 3)


def _duration(rng: np.random.Generator, shortest_s: float, longest_s: float) -> float:
    """Return a time; its logarithm is uniform: short ones are the subtle ones."""
    return round(float(np.exp(rng.uniform(np.log(shortest_s), np.log(longest_s)))), 3)
