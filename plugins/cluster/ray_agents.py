"""Agents on the nodes of a Ray cluster: started, checked, and called from an event loop."""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, wait
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.operator.run_messages import FlightPlace
from wil_campaign.plugins.cluster.cluster_places import waiting_text
from wil_campaign.plugins.cluster.node_agent import NodeAgent
from wil_campaign.plugins.cluster.node_facts import node_facts, unfit_text
from wil_campaign.plugins.cluster.node_messages import (
    DamagedMessageError,
    ToCampaign,
    ToNode,
    decode_facts,
    decode_to_campaign,
    encode_to_node,
)

HIRED_S = 300.0
"""How long to wait for a place on the cluster, and for the first import of our code there."""
REPORT_S = 10.0
"""After so long the user is shown what is waited for: most agents are up by then."""
_LOOK_S = 2.0
_CLOSED_S = 30.0
"""How long the process of a node may take to end once nothing flies."""


class NodeRefusedError(EngineError):
    """A node is lost, or cannot fly for this campaign; others may. Says which, and the remedy."""


@dataclass(slots=True)
class HiredAgent:
    """An agent that is up on a node. actor: Ray's handle. has_campaign: its files are unpacked.

    bench: the bench that it serves; "" for none.
    """

    ray: Any
    actor: Any
    node: str
    has_campaign: bool = False
    is_dead: bool = False
    bench: str = ""

    @property
    def place(self) -> FlightPlace:
        """Return the node and bench where the agent flies."""
        return FlightPlace(self.node, self.bench)

    async def send(self, message: ToNode) -> None:
        """Send a message to the node's process. Raises OSError, EOFError, MessageError."""
        await self.send_packet(encode_to_node(message))

    async def send_packet(self, packet: bytes) -> None:
        """Send an encoded message to the node's process. Raises OSError, EOFError."""
        await self._result_of(self.actor.send.remote(packet))

    def send_soon(self, message: ToNode) -> None:
        """Send a message without waiting; it is lost if the node is."""
        self.actor.send.remote(encode_to_node(message))

    async def receive(self) -> Sequence[ToCampaign]:
        """Return the next messages of the node's process, at least one.

        Raises EOFError, DamagedMessageError.
        """
        while True:
            received = await self._result_of(self.actor.receive.remote(_LOOK_S))
            if received:
                return [decode_to_campaign(one) for one in received]

    async def close(self) -> None:
        """End the node's process and free its place on the cluster."""
        if not self.is_dead:
            with suppress(EOFError, OSError):  # it has ended already
                async with asyncio.timeout(_CLOSED_S):
                    await self._result_of(self.actor.close.remote())
        self.kill()

    def kill(self) -> None:
        """End the agent at once; the run that its node's process flies lands."""
        self.is_dead = True
        self.ray.kill(self.actor, no_restart=True)

    async def _result_of(self, reference: Any) -> Any:
        """Return what a call of the agent returns. Raises EOFError, OSError."""
        try:
            return await asyncio.wrap_future(reference.future())
        except self.ray.exceptions.RayError as error:
            cause = getattr(error, "cause", None)
            if not isinstance(cause, OSError | EOFError):
                self.is_dead = True
            raise EOFError(str(error)) from error


class AgentHire:
    """A request for an agent, which is up once the cluster has a place for it.

    ray: the module. cores: the CPUs of a node that a run takes.
    """

    def __init__(self, ray: Any, cores: int) -> None:
        # Ray must not repeat a run by itself: the campaign's ledger decides.
        remote = ray.remote(
            num_cpus=cores,
            max_restarts=0,
            max_task_retries=0,
            max_concurrency=8,
            scheduling_strategy="SPREAD",
        )(NodeAgent)
        self._ray = ray
        self._actor = remote.remote()
        self.future: Future[Any] = self._actor.receive.remote(HIRED_S).future()
        """The future of the agent's first message; an error of Ray where its node cannot fly."""
        self._is_dismissed = False

    def dismiss(self) -> None:
        """Cancel the request, or end the agent; a second call changes nothing."""
        if not self._is_dismissed:
            self._is_dismissed = True
            self._ray.kill(self._actor, no_restart=True)

    def agent(self) -> HiredAgent:
        """Return the agent if it is up with the programs of this machine.

        Raises NodeRefusedError.
        """
        try:
            facts = fit_facts(self._first_messages(), "a node of the cluster")
        except EngineError:
            self.dismiss()
            raise
        return HiredAgent(ray=self._ray, actor=self._actor, node=facts["node"])

    def _first_messages(self) -> list[bytes]:
        try:
            messages: list[bytes] = self.future.result()
        except self._ray.exceptions.RayError as error:
            raise NodeRefusedError(
                f"a node of the cluster cannot fly: {_last_line(error)}; install the same wheel of "
                "wil-campaign[cluster] with the same constraints on every node",
                2,
            ) from error
        return messages


def fit_facts(messages: Sequence[bytes], sender: str, *, silent_code: int = 3) -> dict[str, str]:
    """Return a node's facts, from its first messages. sender: in words.

    Raises NodeRefusedError where there are none (with silent_code), and for a node with other
    programs.
    """
    if not messages:
        raise NodeRefusedError(f"{sender} sent no message in time", silent_code)
    try:
        facts = decode_facts(messages[0])
    except DamagedMessageError as error:
        raise NodeRefusedError(
            f"the facts of {sender} cannot be read: {error}; install the same wheel of "
            "wil-campaign[cluster] with the same constraints there"
        ) from error
    if why := unfit_text(node_facts(), facts):
        raise NodeRefusedError(why, 2)
    return facts


def hire_agents(
    ray: Any, count: int, *, cores: int, say: Callable[[str], None] = lambda _: None
) -> list[HiredAgent]:
    """Return agents that are up, on nodes with the programs of this machine; fewer if fewer fit.

    cores: the CPUs of a node that a run takes. say: called with what is waited for. Raises
    EngineError, also where there is no place for any agent.
    """
    hires = [AgentHire(ray, cores) for _ in range(count)]
    try:
        up = _await_hires(ray, hires, cores, say)
        agents = [one.agent() for one in up]
    except BaseException:
        for hire in hires:
            hire.dismiss()
        raise
    for hire in hires:
        if hire not in up:
            hire.dismiss()
    if len(up) < count:
        say(f"{len(up)} of {count} runs have a place on the cluster and start")
    return agents


def _await_hires(
    ray: Any, hires: Sequence[AgentHire], cores: int, say: Callable[[str], None]
) -> list[AgentHire]:
    """Return the requests with an answer, once all have one or after HIRED_S.

    Raises EngineError where none has.
    """
    futures = [hire.future for hire in hires]
    late = wait(futures, REPORT_S, return_when=FIRST_EXCEPTION).not_done
    if late and not any(future.done() and future.exception() for future in futures):
        say(f"{waiting_text(ray.nodes(), cores)}; waiting up to {HIRED_S:g} s")
        wait(futures, HIRED_S - REPORT_S, return_when=FIRST_EXCEPTION)
    up = [hire for hire in hires if hire.future.done()]
    if hires and not up:
        raise EngineError(no_place_text(len(hires), cores))
    return up


def no_place_text(count: int, cores: int) -> str:
    """Return the message for a cluster that had no place in time."""
    return (
        f"the cluster has no place for {count} runs of {cores} CPUs each within {HIRED_S:g} s: "
        "lower --jobs, or add nodes"
    )


def _last_line(error: Exception) -> str:
    text = str(error).strip()
    return text.splitlines()[-1] if text else repr(error)
