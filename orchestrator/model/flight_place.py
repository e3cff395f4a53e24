"""Where a run flies: the node of a cluster, and the test bench."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FlightPlace:
    """A node and a test bench; both empty for this machine. str(): in words, or ""."""

    node: str = ""
    bench: str = ""

    def __str__(self) -> str:
        if not self.bench:
            return self.node
        return f"bench {self.bench} on {self.node}" if self.node else f"bench {self.bench}"

    def is_meant(self, *, node: str, bench: str) -> bool:
        """Return whether a command addresses this place; an empty node or bench addresses all."""
        return node in {"", self.node} and bench in {"", self.bench}
