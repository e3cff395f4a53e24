"""What a campaign accepts: of each case and mode that is required, k runs of n must pass."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

_OF = re.compile(r"\s*([0-9]{1,6})\s*/\s*([0-9]{1,6})\s*")


@dataclass(frozen=True, slots=True)
class Share:
    """A share for `accept`: `passes` of `runs`, written "4/5"."""

    passes: int
    runs: int

    def __str__(self) -> str:
        return f"{self.passes}/{self.runs}"

    def scaled(self, runs: int) -> "Share":
        """Return the acceptance share for another number of runs, rounded up: 4/5 of 3 is 3/3."""
        return Share(-(-self.passes * runs // self.runs), runs)


@dataclass(frozen=True, slots=True)
class Requirement:
    """An acceptance requirement: the share of a case in a mode that must pass."""

    case: str
    mode: str
    share: Share


@dataclass(frozen=True, slots=True)
class Standing:
    """The standing of an acceptance requirement: its passes and its flown runs."""

    requirement: Requirement
    passed: int
    flown: int

    @property
    def met(self) -> bool:
        """Return whether enough runs passed for acceptance."""
        return self.passed >= self.requirement.share.passes

    def __str__(self) -> str:
        wanted = self.requirement
        said = f"{wanted.case}/{wanted.mode}: {self.passed} passed, {wanted.share} required"
        missing = wanted.share.runs - self.flown
        return f"{said}, {missing} not flown" if missing > 0 else said


def parse_share(text: str) -> Share:
    """Return the acceptance share in a text. Raises ValueError with what is wrong with it."""
    match = _OF.fullmatch(text)
    if match is None:
        raise ValueError(f"must be passes/runs like 4/5, is '{text}'")
    share = Share(int(match[1]), int(match[2]))
    if not 1 <= share.passes <= share.runs:
        raise ValueError(f"must ask for at least 1 pass and at most all, is '{text}'")
    return share


def standings(
    requirements: Iterable[Requirement], passed: Iterable[tuple[str, str, bool]]
) -> tuple[Standing, ...]:
    """Return the standing of each requirement. passed: (case, mode, whether it passed) per run."""
    counts: dict[tuple[str, str], list[bool]] = {}
    for case, mode, good in passed:
        counts.setdefault((case, mode), []).append(good)
    return tuple(
        Standing(wanted, sum(flown), len(flown))
        for wanted in requirements
        for flown in [counts.get((wanted.case, wanted.mode), [])]
    )
