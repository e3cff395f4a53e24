"""How many runs fit on a cluster, from what Ray says of its nodes."""

from typing import Any

from wil_campaign.plugins.cluster.cluster_places import (
    places_by_node,
    shortage_text,
    waiting_text,
)


def node(name: str, cpus: float | None, *, alive: bool = True) -> dict[str, Any]:
    resources = {} if cpus is None else {"CPU": cpus}
    return {"Alive": alive, "NodeManagerHostname": name, "Resources": resources}


CLUSTER = [
    node("first", 3.0),
    node("second", 4.0),
    node("second", None),  # of a bench, on the same machine
    node("third", 8.0, alive=False),
]


def test_places_are_counted_by_machine_and_none_on_a_lost_node() -> None:
    assert places_by_node(CLUSTER, 1) == {"first": 3, "second": 4}
    assert places_by_node(CLUSTER, 2) == {"first": 1, "second": 2}


def test_a_shortage_names_the_places_of_each_node() -> None:
    assert shortage_text(CLUSTER, 3, 2) == ""
    assert shortage_text(CLUSTER, 4, 2) == (
        "the cluster has place for 3 of 4 runs at once, of 2 CPUs each (first 1, second 2)"
    )
    assert "(no node)" in shortage_text([], 1, 1)
    assert waiting_text(CLUSTER, 1).endswith("places: first 3, second 4")
