"""The expected verdict and cause of a control run, which shows that its campaign can fail."""

from dataclasses import dataclass
from typing import Literal

ControlVerdict = Literal["FAIL", "INVALID", "ERROR"]


@dataclass(frozen=True, slots=True)
class Expectation:
    """The expected end of a control run. oracle: the one that must fail; cause: in the reason."""

    case: str
    verdict: ControlVerdict
    oracle: str | None = None
    cause: str | None = None

    def __str__(self) -> str:
        by = "" if self.oracle is None else f" by {self.oracle}"
        return f"{self.verdict}{by}" + ("" if self.cause is None else f" ({self.cause})")
