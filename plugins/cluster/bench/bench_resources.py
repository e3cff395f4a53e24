"""Benches as resources of Ray nodes: how a node announces one, and how they are read; pure.

`bench:NAME` exists once, and a campaign takes all of it; `bench_property:NAME:PAIR` names a
property of the bench: key and value as JSON, percent-encoded, because Ray passes the names of
resources on in a list separated by commas.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, unquote

from wil_campaign.campaigns.schema.bench import BenchRequestPart, PropertyValue
from wil_campaign.campaigns.setup.bench_file import BenchFacts
from wil_campaign.campaigns.setup.bench_resolution import fitting_benches, no_bench_text
from wil_campaign.foundation.files.documents import BadInput, Document

_BENCH, _PROPERTY = "bench:", "bench_property:"


@dataclass(frozen=True, slots=True)
class AnnouncedBench:
    """A bench of a cluster node. node: the node's name."""

    facts: BenchFacts
    node: str


def bench_resource_name(name: str) -> str:
    """Return the name of a bench's resource."""
    return f"{_BENCH}{name}"


def announced_resources(facts: BenchFacts) -> dict[str, float]:
    """Return the resources by which a node announces its bench."""
    properties = (quote(json.dumps(pair), safe="") for pair in sorted(facts.properties.items()))
    return {
        bench_resource_name(facts.name): 1.0,
        **{f"{_PROPERTY}{facts.name}:{text}": 1.0 for text in properties},
    }


def announced_benches(nodes: Iterable[Mapping[str, Any]]) -> list[AnnouncedBench]:
    """Return the benches of a cluster's live nodes, as Ray describes them."""
    benches: list[AnnouncedBench] = []
    for node in nodes:
        resources = list(node.get("Resources", {})) if node.get("Alive") else []
        for resource in resources:
            if not resource.startswith(_BENCH):
                continue
            name = resource.removeprefix(_BENCH)
            start = f"{_PROPERTY}{name}:"
            texts = (one.removeprefix(start) for one in resources if one.startswith(start))
            properties: dict[str, PropertyValue] = dict(json.loads(unquote(text)) for text in texts)
            where = str(node.get("NodeManagerHostname") or node.get("NodeManagerAddress"))
            benches.append(AnnouncedBench(BenchFacts(name, properties), where))
    return benches


def chosen_bench(
    file: Document, request: BenchRequestPart, there: Sequence[AnnouncedBench]
) -> str | None:
    """Return the name of the bench that fits a request, the first by name; None without one.

    Raises BadInput where two benches of the cluster have this name.
    """
    fitting = fitting_benches(request, [bench.facts for bench in there])
    if not fitting:
        return None
    name = min(bench_facts.name for bench_facts in fitting)
    nodes = [bench.node for bench in there if bench.facts.name == name]
    if len(nodes) > 1:
        text = f"the cluster has two benches named '{name}', on {' and '.join(nodes)}; rename one"
        raise BadInput([file.problem(("bench",), text, key=True)])
    return name


def missing_bench(
    file: Document, request: BenchRequestPart, there: Sequence[AnnouncedBench]
) -> BadInput:
    """Return the error of a campaign whose bench has not appeared within its `wait_s`."""
    problem = no_bench_text(file, request, [bench.facts for bench in there])
    text = f"{problem.message}, after {request.wait_s:g} s (bench.wait_s)"
    return BadInput([file.problem(("bench",), text, problem.suggestion, key=True)])
