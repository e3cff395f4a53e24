"""What the autonomy under test may take of the machine."""

from dataclasses import dataclass

LONGEST_CALL_S = 30.0
LONGEST_BUILD_S = 300.0
"""Wall time for a call, and for a constructor that loads a model. Before a worker that is silent
is killed, and under the wall clock long after the guard has taken over."""


@dataclass(frozen=True, slots=True)
class AutonomyLimits:
    """The limits of the autonomy. memory_mb: by how much what runs it may grow, in 10^6 bytes.

    call_s: wall time of one call of `perceive` or `act`; build_s: of its import and constructor.
    """

    memory_mb: float = 4000.0
    call_s: float = LONGEST_CALL_S
    build_s: float = LONGEST_BUILD_S

    def excess(self, measure: str, used_mb: float) -> str:
        """Return in words that memory is beyond the limit, and what to do; empty within it."""
        if used_mb <= self.memory_mb:
            return ""
        return (
            f"uses too much memory: {measure} {used_mb:.0f} MB, and autonomy.limits.memory_mb is "
            f"{self.memory_mb:g}; find what it keeps from call to call, or raise the limit"
        )
