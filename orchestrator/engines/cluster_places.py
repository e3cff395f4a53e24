"""How many runs fit on the nodes of a Ray cluster, and in words what has to be waited for; pure."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any


def places_by_node(nodes: Iterable[Mapping[str, Any]], cores: int) -> dict[str, int]:
    """Return how many runs fit on each node that is alive, whatever flies there already.

    nodes: as Ray describes them. cores: that a run takes.
    """
    places: Counter[str] = Counter()
    for node in nodes:
        if node.get("Alive"):
            # A machine may be several nodes: that of its bench has no place for other runs.
            name = str(node.get("NodeManagerHostname") or node.get("NodeName", ""))
            places[name] += int(node.get("Resources", {}).get("CPU", 0)) // max(cores, 1)
    return dict(places)


def shortage_text(nodes: Iterable[Mapping[str, Any]], wanted: int, cores: int) -> str:
    """Return what keeps a cluster from flying so many runs at once; "" where nothing does."""
    places = places_by_node(nodes, cores)
    fit = sum(places.values())
    if fit >= wanted:
        return ""
    begin = f"the cluster has place for {fit} of {wanted} runs at once"
    return f"{begin}, of {_cpus(cores)} each ({_listed(places)})"


def waiting_text(nodes: Iterable[Mapping[str, Any]], cores: int) -> str:
    """Return what a run waits for that has found no place on a cluster."""
    return (
        f"a run waits for a worker with {_cpus(cores)}: its node still loads wil-campaign, others "
        f"have its place, or a node is missing; places: {_listed(places_by_node(nodes, cores))}"
    )


def _cpus(count: int) -> str:
    return "1 CPU" if count == 1 else f"{count} CPUs"


def _listed(places: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in sorted(places.items())) or "no node"
