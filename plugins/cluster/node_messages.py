"""Messages between the machine of a campaign and the process on a node or the server of a bench."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import msgspec

from wil_campaign.foundation.files.yaml_nodes import YamlEntry, YamlNode, YamlPlace, YamlSource
from wil_campaign.foundation.processes.codec import (
    MessageCodec,
    Plain,
    ProcessMessage,
    ProcessMessageError,
)
from wil_campaign.orchestrator.campaign.workers.run_order import map_documents
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.operator.run_messages import News, RunEventReport, RunProgressReport
from wil_campaign.orchestrator.run_results.campaign_results import VehicleKind
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster.travelling_files import TravellingFiles
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

Decoded = TypeVar("Decoded")


class DamagedMessageError(OSError):
    """Bytes between the machines of a cluster that are no message; says why."""


class NodeFacts(ProcessMessage, frozen=True):
    """The first message of a node: what its machine and its programs are, by `node_facts`."""

    facts: dict[str, str]


class CampaignBrought(ProcessMessage, frozen=True):
    """A campaign for a node. folder: of its results on the campaign's machine, absolute.

    session: which start of the campaign this is, as the ledger in that folder says. store: the URL
    to which results go; place: the campaign's in it.
    """

    folder: Path
    session: str
    files: TravellingFiles
    store: str
    place: str


class CampaignAnswer(ProcessMessage, frozen=True):
    """The node has unpacked the campaign; problem: why it cannot fly it, "" where it can."""

    problem: str = ""


class RunOrdered(ProcessMessage, frozen=True):
    """A run to be flown on the node. place: its own in the store.

    sources: the YAML texts of the order's documents, while the message is bytes: each value of a
    document knows its text, which is sent once.
    """

    order: RunOrder
    place: str
    sources: tuple[YamlSource, ...] = ()


class CommandSent(ProcessMessage, frozen=True):
    """An operator's command for the run on the node."""

    command: OperatorCommand


class NodeRunProgress(ProcessMessage, frozen=True):
    """The progress of the run on the node."""

    news: RunProgressReport


class NodeRunHappening(ProcessMessage, frozen=True):
    """An event of the run on the node."""

    news: RunEventReport


class RunSending(ProcessMessage, frozen=True):
    """A node sends the files of a run to the store. files: how many it has sent so far."""

    files: int


class RunTaken(ProcessMessage, frozen=True):
    """The campaign's machine is done with a run in the store. is_there: it has all of its files.

    place: the run's in the store.
    """

    place: str
    is_there: bool


class RunEnded(ProcessMessage, frozen=True):
    """A run on the node has ended: with a result, or lost without one.

    sha256: of its result.json; "" where it wrote none. end_text: what was wrong with the end of its
    process. kept: where the node has its files until it receives RunTaken; "" where it has
    none.
    """

    result: RunResult | None = None
    lost: WorkerLost | None = None
    sha256: str = ""
    end_text: str = ""
    kept: str = ""

    @classmethod
    def of(
        cls,
        outcome: RunResult | WorkerLost,
        sha256: str = "",
        *,
        end_text: str = "",
        kept: str = "",
    ) -> "RunEnded":
        """Return the message for an outcome."""
        if isinstance(outcome, WorkerLost):
            return cls(lost=outcome, sha256=sha256, end_text=end_text, kept=kept)
        return cls(result=outcome, sha256=sha256, end_text=end_text, kept=kept)

    @property
    def outcome(self) -> RunResult | WorkerLost:
        """Return the run's result, or why it has none."""
        return self.result or self.lost or WorkerLost("its node reports an end without a result")


class ConsentAsked(ProcessMessage, frozen=True):
    """A campaign requests to fly on the bench. runs: how many. arm: False for --no-arm.

    place: the machine and the user that request it.
    """

    campaign: str
    runs: int
    arm: bool
    place: str


class ConsentAnswer(ProcessMessage, frozen=True):
    """The bench's answer. problem: why nothing is flown, "" where it may; code: of exit.

    real_kind: what the vehicle is. hardware: its name where it is no simulation. vehicle: the
    vehicle in words.
    """

    problem: str = ""
    code: int = 2
    real_kind: VehicleKind = "unknown"
    hardware: str = ""
    vehicle: str = ""


ToNode = CampaignBrought | RunOrdered | RunTaken | CommandSent | ConsentAsked
ToCampaign = (
    NodeFacts
    | CampaignAnswer
    | NodeRunProgress
    | NodeRunHappening
    | RunSending
    | RunEnded
    | ConsentAnswer
)

_PLAIN: Plain = {Path: (os.fsencode, lambda name: Path(os.fsdecode(name)))}
"""Paths are bytes: names of files need not be UTF-8."""
_to_node: MessageCodec[ToNode] = MessageCodec(ToNode, plain=_PLAIN)
_to_campaign: MessageCodec[ToCampaign] = MessageCodec(ToCampaign, plain=_PLAIN)


def encode_to_node(message: ToNode) -> bytes:
    """Return the bytes of a message to a node. Raises MessageError for an order that has none."""
    try:
        return _to_node.encode(
            _detach_sources(message) if isinstance(message, RunOrdered) else message
        )
    except (OverflowError, UnicodeEncodeError) as error:
        raise ProcessMessageError(
            f"a value of the campaign cannot be sent to a node: {error}"
        ) from error


def decode_to_node(content: bytes) -> ToNode:
    """Return the message to a node in bytes. Raises DamagedMessageError."""
    message = _decode(_to_node, content)
    if not isinstance(message, RunOrdered):
        return message
    try:
        return _attach_sources(message)
    except (ValueError, IndexError) as error:
        raise DamagedMessageError(
            f"an order names a text that it does not have: {error}"
        ) from error


def encode_to_campaign(message: ToCampaign) -> bytes:
    """Return the bytes of a message to the machine of a campaign."""
    try:
        return _to_campaign.encode(message)
    except UnicodeEncodeError:  # half of a surrogate pair, as an error of an autonomy may have it
        return _to_campaign.encode(_escape_surrogates(msgspec.to_builtins(message)))


def decode_to_campaign(content: bytes) -> ToCampaign:
    """Return the message to the machine of a campaign in bytes. Raises DamagedMessageError."""
    return _decode(_to_campaign, content)


def decode_facts(content: bytes) -> dict[str, str]:
    """Return a node's facts, its first message. Raises DamagedMessageError."""
    message = decode_to_campaign(content)
    if not isinstance(message, NodeFacts) or "node" not in message.facts:
        raise DamagedMessageError(f"{len(content)} bytes are not the facts of a node")
    return message.facts


def news_message(news: News) -> NodeRunProgress | NodeRunHappening:
    """Return the message for news of a run."""
    return NodeRunProgress(news) if isinstance(news, RunProgressReport) else NodeRunHappening(news)


def _decode(codec: MessageCodec[Decoded], content: bytes) -> Decoded:
    """Return the message in bytes. Raises DamagedMessageError."""
    try:
        return codec.decode(content)
    except ProcessMessageError as error:
        raise DamagedMessageError(str(error)) from error


def _detach_sources(ordered: RunOrdered) -> RunOrdered:
    """Return an order in whose documents each source is its index among `sources`."""
    indices: dict[int, tuple[YamlSource, YamlSource]] = {}

    def index_of(source: YamlSource) -> YamlSource:
        return indices.setdefault(id(source), (YamlSource(str(len(indices))), source))[0]

    order = _map_sources(ordered.order, index_of)
    return RunOrdered(order, ordered.place, tuple(_named(source) for _, source in indices.values()))


def _named(source: YamlSource) -> YamlSource:
    """Return a source with a name that UTF-8 can hold: files need not have one, and it is read."""
    return replace(source, name=source.name.encode(errors="replace").decode())


def _attach_sources(ordered: RunOrdered) -> RunOrdered:
    """Return an order whose documents have their sources. Raises ValueError, IndexError."""
    sources = ordered.sources
    order = _map_sources(ordered.order, lambda source: sources[int(source.name)])
    return RunOrdered(order, ordered.place)


def _map_sources(order: RunOrder, change: Callable[[YamlSource], YamlSource]) -> RunOrder:
    def of_place(place: YamlPlace) -> YamlPlace:
        return replace(place, source=change(place.source))

    def of_node(node: YamlNode) -> YamlNode:
        value = node.value
        if isinstance(value, dict):
            value = {
                key: YamlEntry(of_place(entry.key), of_node(entry.node))
                for key, entry in value.items()
            }
        elif isinstance(value, tuple):
            value = tuple(map(of_node, value))
        return replace(node, value=value, place=of_place(node.place))

    return map_documents(order, lambda document: replace(document, root=of_node(document.root)))


def _escape_surrogates(value: object) -> object:
    """Return plain values in which every text can be UTF-8."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, dict):
        return {_escape_surrogates(key): _escape_surrogates(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_escape_surrogates(one) for one in value]
    return value
