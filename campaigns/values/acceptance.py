"""Acceptance of a campaign: of each required case and mode, k runs of n must pass."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from wil_campaign.campaigns.statistics.sequential_test import SequentialTest

_OF = re.compile(r"\s*([0-9]{1,6})\s*/\s*([0-9]{1,6})\s*")


@dataclass(frozen=True, slots=True)
class PassShare:
    """A share for `accept`: `passes` of `runs`, written "4/5"."""

    passes: int
    runs: int

    def __str__(self) -> str:
        return f"{self.passes}/{self.runs}"

    def scaled(self, runs: int) -> "PassShare":
        """Return the acceptance share for another number of runs, rounded up: 4/5 of 3 is 3/3."""
        return PassShare(-(-self.passes * runs // self.runs), runs)


DECIDED = "decided"
"""The share in `accept` of a campaign whose repetitions end when a sequential test has decided."""


@dataclass(frozen=True, slots=True)
class PassRequirement:
    """An acceptance requirement: the share of a case in a mode that must pass.

    test: instead, the sequential test that must decide for its pass rate; the share is then of the
    largest number of flights.
    """

    case: str
    mode: str
    share: PassShare
    test: SequentialTest | None = None

    def __str__(self) -> str:
        if self.test is None:
            return str(self.share)
        return f"a pass rate of {self.test.at_least:g} against {self.test.against:g}"


@dataclass(frozen=True, slots=True)
class RequirementStanding:
    """The standing of an acceptance requirement: its passes and its flown runs.

    decision: of its sequential test; empty without one.
    """

    requirement: PassRequirement
    passed: int
    flown: int
    decision: str = ""

    @property
    def met(self) -> bool:
        """Return whether enough runs passed for acceptance."""
        if self.requirement.test is not None:
            return self.decision == "at least"
        return self.passed >= self.requirement.share.passes

    @property
    def is_complete(self) -> bool:
        """Return whether no further run is due."""
        decided = self.decision in {"at least", "below"}
        return decided or self.flown >= self.requirement.share.runs

    def __str__(self) -> str:
        wanted = self.requirement
        text = f"{wanted.case}/{wanted.mode}: {self.passed} passed, {wanted} required"
        if self.decision:
            return f"{text}: {self.decision} after {self.flown}"
        missing = wanted.share.runs - self.flown
        return f"{text}, {missing} not flown" if missing > 0 else text


def parse_pass_share(text: str) -> PassShare:
    """Return the acceptance share in a text. Raises ValueError with the reason."""
    match = _OF.fullmatch(text)
    if match is None:
        raise ValueError(f"must be passes/runs like 4/5, is '{text}'")
    share = PassShare(int(match[1]), int(match[2]))
    if not 1 <= share.passes <= share.runs:
        raise ValueError(f"must ask for at least 1 pass and at most all, is '{text}'")
    return share


def requirement_standings(
    requirements: Iterable[PassRequirement], passed: Iterable[tuple[str, str, bool | None]]
) -> tuple[RequirementStanding, ...]:
    """Return the standing of each requirement.

    passed: (case, mode, whether it passed) per run in their order; None for INVALID and ERROR,
    which a sequential test skips.
    """
    counts: dict[tuple[str, str], list[bool | None]] = {}
    for case, mode, good in passed:
        counts.setdefault((case, mode), []).append(good)
    return tuple(
        RequirementStanding(wanted, sum(map(bool, flown)), len(flown), _decision(wanted, flown))
        for wanted in requirements
        for flown in [counts.get((wanted.case, wanted.mode), [])]
    )


def _decision(wanted: PassRequirement, flown: Iterable[bool | None]) -> str:
    """Return the decision of a requirement's sequential test; empty without one."""
    if wanted.test is None:
        return ""
    return wanted.test.decided_after(one for one in flown if one is not None)[0]
