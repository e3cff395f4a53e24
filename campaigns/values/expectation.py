"""The expected end of a control run: how it must come out to show that its campaign can fail."""

from dataclasses import dataclass
from typing import Literal

ControlVerdict = Literal["FAIL", "INVALID", "ERROR"]


@dataclass(frozen=True, slots=True)
class Expectation:
    """The expected end of a control run. oracle: that must fail; cause: text in the reason."""

    case: str
    verdict: ControlVerdict
    oracle: str | None = None
    cause: str | None = None

    def __str__(self) -> str:
        by = "" if self.oracle is None else f" by {self.oracle}"
        return f"{self.verdict}{by}" + ("" if self.cause is None else f" ({self.cause})")
