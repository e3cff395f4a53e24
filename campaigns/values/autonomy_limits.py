"""Limits of memory and time of the autonomy under test."""

from dataclasses import dataclass

from wil_campaign.worlds.figures import distinct_value_text

LONGEST_CALL_S = 30.0
LONGEST_BUILD_S = 300.0
"""Wall time for a call, and for a constructor that loads a model. Shorter than the time after which
a silent worker is killed; under the wall clock the guard takes over long before."""


@dataclass(frozen=True, slots=True)
class AutonomyLimits:
    """The limits of the autonomy. memory_mb: by how much its process may grow, in 10^6 bytes.

    call_s: wall time of one call of `perceive` or `act`; build_s: of its import and constructor.
    """

    memory_mb: float = 4000.0
    call_s: float = LONGEST_CALL_S
    build_s: float = LONGEST_BUILD_S

    def excess(self, measure: str, used_mb: float) -> str:
        """Return the message that memory exceeds the limit, with the remedy; "" within it."""
        if used_mb <= self.memory_mb:
            return ""
        used = distinct_value_text(used_mb, self.memory_mb, digits=0)
        return (
            f"uses too much memory: {measure} {used} MB, and autonomy.limits.memory_mb is "
            f"{self.memory_mb:g}; find what it keeps from call to call, or raise the limit"
        )
