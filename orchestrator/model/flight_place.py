"""Where a run flies: the node of a cluster, and the bench that it has."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FlightPlace:
    """A node, and its bench; both empty for this machine. str(): in words, "" for this machine."""

    node: str = ""
    bench: str = ""

    def __str__(self) -> str:
        if not self.bench:
            return self.node
        return f"bench {self.bench} on {self.node}" if self.node else f"bench {self.bench}"

    def is_meant(self, *, node: str, bench: str) -> bool:
        """Return whether a command for a node, a bench, both, or (with neither) all is for it."""
        return node in {"", self.node} and bench in {"", self.bench}
