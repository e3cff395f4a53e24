"""How many runs fit on the nodes of a Ray cluster, and the messages about a shortage; pure."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any


def places_by_node(nodes: Iterable[Mapping[str, Any]], cores: int) -> dict[str, int]:
    """Return how many runs fit on each node that is alive, including runs that fly there already.

    nodes: as Ray describes them. cores: the CPUs that a run takes.
    """
    places: Counter[str] = Counter()
    for node in nodes:
        if node.get("Alive"):
            # A machine may be several nodes: the node of its bench has no place for other runs.
            name = str(node.get("NodeManagerHostname") or node.get("NodeName", ""))
            places[name] += int(node.get("Resources", {}).get("CPU", 0)) // max(cores, 1)
    return dict(places)


def shortage_text(nodes: Iterable[Mapping[str, Any]], wanted: int, cores: int) -> str:
    """Return why a cluster cannot fly so many runs at once; "" where it can."""
    places = places_by_node(nodes, cores)
    fit = sum(places.values())
    if fit >= wanted:
        return ""
    text = f"the cluster has place for {fit} of {wanted} runs at once"
    return f"{text}, of {_cpus(cores)} each ({_list_places(places)})"


def waiting_text(nodes: Iterable[Mapping[str, Any]], cores: int) -> str:
    """Return what a run without a place on a cluster waits for."""
    return (
        f"a run waits for a worker with {_cpus(cores)}: its node is still loading wil-campaign, "
        "others have its place, or a node is missing; places: "
        f"{_list_places(places_by_node(nodes, cores))}"
    )


def _cpus(count: int) -> str:
    return "1 CPU" if count == 1 else f"{count} CPUs"


def _list_places(places: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in sorted(places.items())) or "no node"
