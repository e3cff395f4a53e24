"""The flights that must fail without any fault: each fails for its cause, and the sound one passes.

`python -m tests.faults.undisturbed FIRST COUNT FOLDER` prints one JSON object for each.
"""

import json
import sys
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path

from tests.faults.missions import CAUSES, AutopilotKind, Cause, JudgedBy, Mode
from tests.faults.signals import Outcome, SignalFault, draw, fails_for_its_cause, fly_mission

COMBINATIONS: tuple[tuple[Mode, AutopilotKind, JudgedBy], ...] = (
    ("sim", "px4", "mavlink"),
    ("sim", "ardupilot", "mavlink"),
    ("sim", "px4", "mocap"),
    ("wil", "px4", "mocap"),
    ("wil", "px4", "mavlink"),
    ("wil", "ardupilot", "mocap"),
    ("sim", "px4", "simulator"),
    ("sim", "ardupilot", "simulator"),
    ("wil", "px4", "simulator"),
)
_EACH: tuple[Cause, ...] = (*CAUSES, "none")
ALL = tuple(product(COMBINATIONS, _EACH))


def flight(number: int) -> SignalFault:
    """Return a flight by its number; its alteration is not used."""
    (mode, autopilot, judged_by), cause = ALL[number]
    return replace(draw(number), mode=mode, autopilot=autopilot, judged_by=judged_by, cause=cause)


def fly_undisturbed(number: int, folder: Path) -> Outcome:
    """Fly one; wrong when it does not fail for its cause, or does though it has none."""
    given = flight(number)
    result = fly_mission(given, folder, None)
    wrong = not fails_for_its_cause(given, result)
    return Outcome(given, result.verdict, result.reason, result.decided_by or "", False, wrong)


def main(arguments: list[str]) -> None:
    first, count, folder = int(arguments[0]), int(arguments[1]), Path(arguments[2])
    for number in range(first, min(first + count, len(ALL))):
        outcome = fly_undisturbed(number, folder / str(number))
        sys.stdout.write(json.dumps(asdict(outcome)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
