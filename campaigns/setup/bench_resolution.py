"""Choose the bench of a campaign, and merge the bench's vehicle and fence into the campaign.

Pure: documents in, a document out. A key may be in one of the two files, never in both, so that
neither file hides a value of the other.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from wil_campaign.campaigns.schema.bench import BenchRequestPart, PropertyValue
from wil_campaign.campaigns.setup.bench_file import Bench, BenchFacts, property_text_in_file
from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    Problem,
    YamlEntry,
    check_document,
    closest_word,
)
from wil_campaign.foundation.files.documents import Path as KeyPath
from wil_campaign.foundation.files.paths import expanded_path
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.foundation.files.yaml_nodes import (
    Data,
    YamlNode,
    mapping_node,
    plain_value_of_node,
)

BENCH: KeyPath = ("bench",)
_TAKEN: tuple[KeyPath, ...] = (("vehicles", "real"), ("geofence",))
"""What a campaign takes from its bench."""
_MERGED: frozenset[KeyPath] = frozenset(
    {("vehicles", "real"), ("vehicles", "real", "sensors"), ("vehicles", "real", "params")}
)
"""Mappings to which both files may add keys; any other value comes from one file as a whole."""
_FILES: tuple[KeyPath, ...] = (
    ("vehicles", "real", "profile"),
    ("vehicles", "real", "signing", "file"),
    ("geofence", "file"),
    ("geofence", "real", "file"),
    ("geofence", "twin", "file"),
)
"""Keys that name a file beside the bench file; those of sensors are found by `_names_file`."""


def bench_request(file: Document) -> BenchRequestPart | None:
    """Return a campaign's request for a bench; None without one. Raises BadInput."""
    if file.get(BENCH) is None:
        return None
    return check_document(file, BenchRequestPart, at=BENCH)


def choose_bench(file: Document, benches: Sequence[Bench]) -> Bench | None:
    """Return the bench that a campaign asks for, the first by name; None where it asks for none.

    Raises BadInput where none of these fits, or where one is given and none is asked for.
    """
    request = bench_request(file)
    if request is None:
        if benches:
            names = " or ".join(sorted(bench.name for bench in benches))
            message = f"asks for no bench, but --bench-file gives {names}; write `bench: {names}`"
            raise BadInput([file.problem(("campaign",), message, key=True)])
        return None
    if not benches:
        message = (
            "asks for a bench: give the file of one of this machine by --bench-file FILE, or fly "
            "over a cluster that a bench has joined, by --engine ray://HOST:PORT"
        )
        raise BadInput([file.problem(BENCH, message, key=True)])
    facts = [bench.facts for bench in benches]
    fitting = fitting_benches(request, facts)
    if not fitting:
        raise BadInput([no_bench_text(file, request, facts)])
    name = min(bench_facts.name for bench_facts in fitting)
    return next(bench for bench in benches if bench.name == name)


def fitting_benches(request: BenchRequestPart, benches: Sequence[BenchFacts]) -> list[BenchFacts]:
    """Return the benches that have the requested name and properties."""
    return [
        bench
        for bench in benches
        if request.name in {None, bench.name}
        and all(_has(bench, key, value) for key, value in request.properties.items())
    ]


def campaign_with_bench(file: Document, bench: Bench) -> Document:
    """Return a campaign with its bench's vehicle and fence. Raises BadInput.

    Each value keeps its place in its own file. A key that both files have is a problem.
    """
    merger = _Merger(bench)
    root = file.root
    for path in _TAKEN:
        entry = bench.document.entry(path)
        taken = YamlEntry(entry.key, _absolute(entry.node, path, bench.document.path.parent))
        root = merger.add(root, (), path, taken)
    if merger.problems:
        raise BadInput(merger.problems)
    return Document(file.path, root)


def bench_completion(bench: Bench | None) -> Callable[[Document], Document]:
    """Return a function that completes a campaign's document with what its bench defines."""
    return (
        (lambda document: document) if bench is None else partial(campaign_with_bench, bench=bench)
    )


def bench_departure(file: Document, bench: Bench) -> str:
    """Return how a campaign's vehicles and fence differ from those of its bench; "" if they agree.

    campaign: one that has been completed by `campaign_with_bench`, perhaps on another machine.
    """
    there = file.data
    vehicles = there.get("vehicles") if isinstance(there, dict) else None
    twin = vehicles.get("twin") if isinstance(vehicles, dict) else None
    link = twin.get("link") if isinstance(twin, dict) else None
    if isinstance(link, str) and link != "embedded":
        return f"vehicles.twin.link is {link}: a bench has one vehicle, the real one"
    actors = there.get("actors") if isinstance(there, dict) else None
    for name, actor in actors.items() if isinstance(actors, dict) else ():
        link = actor.get("link") if isinstance(actor, dict) else None
        if isinstance(link, str) and link != "embedded":
            return f"actors.{name}.link is {link}: a bench has one vehicle, the real one"
    for path in _TAKEN:
        entry = bench.document.entry(path)
        wanted = plain_value_of_node(_absolute(entry.node, path, bench.document.path.parent))
        found = _differing(file.get(path), wanted, path)
        if found:
            return f"{'.'.join(map(str, found))} differs from that of bench {bench.name}"
    return ""


def _differing(there: Data, wanted: Data, path: KeyPath) -> KeyPath:
    """Return the path of a value that is not the bench's; () for none."""
    if path not in _MERGED or not isinstance(wanted, dict):
        return () if there == wanted else path
    for key, value in wanted.items():
        inner = there.get(key) if isinstance(there, dict) else None
        if found := _differing(inner, value, (*path, key)):
            return found
    return ()


def _has(bench: BenchFacts, key: str, value: PropertyValue) -> bool:
    """Return whether a bench has a property with this value; true is not the same as 1."""
    there = bench.properties.get(key)
    return there == value and isinstance(there, bool) == isinstance(value, bool)


def no_bench_text(
    file: Document, request: BenchRequestPart, benches: Sequence[BenchFacts]
) -> Problem:
    """Return why no bench fits, at the key that no bench has."""
    named = [bench for bench in benches if request.name in {None, bench.name}]
    ordered = sorted(benches, key=lambda bench: bench.name)
    there = "; ".join(map(str, ordered)) or "none"
    if not named:
        at = BENCH if isinstance(file.get(BENCH), str) else (*BENCH, "name")
        message = f"there is no bench '{request.name}'; there is {there}"
        return file.problem(at, message, closest_word(str(request.name), [b.name for b in benches]))
    for key, value in request.properties.items():
        at = (*BENCH, "properties", key)
        if not any(key in bench.properties for bench in named):
            known = sorted({name for bench in named for name in bench.properties})
            message = f"no bench has the property '{key}'; there is {there}"
            return file.problem(at, message, closest_word(key, known), key=True)
        if not any(_has(bench, key, value) for bench in named):
            return file.problem(
                at, f"no bench has {key}: {property_text_in_file(value)}; there is {there}"
            )
    message = f"no bench has all of these properties; there is {there}"
    return file.problem((*BENCH, "properties"), message, key=True)


@dataclass(frozen=True, slots=True)
class _Merger:
    """Adds a bench's entries to a campaign's nodes; problems are collected."""

    bench: Bench
    problems: list[Problem] = field(default_factory=list)

    def add(self, node: YamlNode, above: KeyPath, way: KeyPath, taken: YamlEntry) -> YamlNode:
        """Return a node with an entry at the end of a way of keys. above: the node's own path."""
        entries = dict(node.value) if isinstance(node.value, dict) else {}
        key = str(way[0])
        path = (*above, key)
        present = entries.get(key)
        if way[1:]:
            inner = mapping_node({}, taken.key) if present is None else present.node
            place = taken.key if present is None else present.key
            entries[key] = YamlEntry(place, self.add(inner, path, way[1:], taken))
        elif present is None:
            entries[key] = taken
        else:
            entries[key] = YamlEntry(present.key, self._merge(path, present, taken))
        return mapping_node(entries, node.place)

    def _merge(self, path: KeyPath, present: YamlEntry, taken: YamlEntry) -> YamlNode:
        """Return the value of a key that both files have."""
        if path in _MERGED and isinstance(taken.node.value, dict) and _is_open(present.node):
            merged = present.node
            for name, entry in taken.node.value.items():
                merged = self.add(merged, path, (name,), entry)
            return merged
        where = printable_problem(f"{taken.key.source.name}:{taken.key.line}:{taken.key.column}")
        message = f"{'.'.join(map(str, path))} is defined by bench {self.bench.name} ({where})"
        self.problems.append(present.key.problem(f"{message}; remove it here"))
        return present.node


def _is_open(node: YamlNode) -> bool:
    """Return whether keys can be added to a value: a mapping, or nothing."""
    return node.value is None or isinstance(node.value, dict)


def _absolute(node: YamlNode, path: KeyPath, folder: Path) -> YamlNode:
    """Return a bench's value with the files that it names, beside the bench file, absolute."""
    if isinstance(node.value, dict):
        inner = {
            key: YamlEntry(entry.key, _absolute(entry.node, (*path, key), folder))
            for key, entry in node.value.items()
        }
        return mapping_node(inner, node.place)
    if not (isinstance(node.value, str) and _names_file(path, node.value)):
        return node
    return YamlNode(str((folder / expanded_path(Path(node.value))).absolute()), node.place)


def _names_file(path: KeyPath, text: str) -> bool:
    if path == _FILES[0]:
        return text.endswith((".yaml", ".yml"))
    if path in _FILES:
        return True
    if path[:3] != ("vehicles", "real", "sensors"):
        return False
    is_address = path[4:] in {("source",), ("source", "address")}
    return path[4:] == ("calibration",) or (is_address and "://" not in text)
