"""What an oracle says: fields exactly as results carry them."""

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["PASS", "FAIL", "INVALID", "ERROR", "ABORTED"]
Limit = float | tuple[float | None, float | None] | None


@dataclass(frozen=True, slots=True)
class OracleResult:
    """One oracle's judgement of one run.

    actual: the worst value in its window, at_s when (run clock). limit: a number or (low, high).
    margin: signed distance to the nearest limit, positive is good; None for pure events.
    No value is ever NaN or infinite. detail: a sentence for people ("touched gate.left").
    """

    name: str
    vehicle: str
    required: bool
    verdict: Literal["PASS", "FAIL"]
    actual: float | None
    limit: Limit
    unit: str
    margin: float | None
    at_s: float | None
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Flag:
    """Something decisive seen at a moment: a contact, a breach. Published when it happens."""

    t_s: float
    oracle: str
    vehicle: str
    text: str
    decisive: bool = False
    """Whether this alone settles the oracle as FAIL, now."""
