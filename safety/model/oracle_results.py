"""Results of oracles and of evidence; the fields are those of result files."""

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["PASS", "FAIL", "INVALID", "ERROR", "ABORTED"]
OracleVerdict = Literal["PASS", "FAIL", "INVALID"]
Limit = float | tuple[float | None, float | None] | None


@dataclass(frozen=True, slots=True)
class OracleResult:
    """One oracle's result of one run.

    verdict: INVALID where a signal that it needs is missing; detail names it.
    actual: the worst value in its window, at_s when (run clock). limit: a number or (low, high).
    margin: signed distance to the nearest limit, positive is good; None for pure events.
    No value is ever NaN or infinite. detail: a sentence for people ("touched gate.left").
    """

    name: str
    vehicle: str
    required: bool
    verdict: OracleVerdict
    actual: float | None
    limit: Limit
    unit: str
    margin: float | None
    at_s: float | None
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceResult:
    """The evidence result of one signal over the time in which it was judged.

    signal, vehicle, source: "pose" of "real" from "mocap". required: whether a required oracle
    depends on it. first_s, last_s, count: times of its first and last sample within the window
    (None without any), and how many there are. largest_gap_s, gap_at_s: the longest time without a
    sample, and when that began. limit_s: the longest accepted gap. verdict: INVALID where the
    signal cannot show what happened; reason: why, and when. compared_with: the other sources with
    which it was compared. caveat: what a PASS by this signal has to be read with. Times are on the
    run clock.
    """

    signal: str
    vehicle: str
    source: str
    required: bool
    first_s: float | None
    last_s: float | None
    count: int
    largest_gap_s: float
    gap_at_s: float | None
    limit_s: float
    verdict: Literal["PASS", "INVALID"]
    reason: str = ""
    compared_with: tuple[str, ...] = ()
    caveat: str = ""


@dataclass(frozen=True, slots=True)
class Flag:
    """A decisive moment of an oracle: a contact, a breach. Published when it happens."""

    t_s: float
    oracle: str
    vehicle: str
    text: str
    decisive: bool = False
    """Whether this alone settles the oracle as FAIL, now."""
