"""The engine that flies a campaign on a bench of a Ray cluster, through the bench's server.

The Ray actor on the node of a bench: relays bytes to and from the bench's server.

The server is no part of Ray: when the actor ends, its connection ends, and the run lands.
"""

import asyncio
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Client
from pathlib import Path
from typing import Any

from wil_campaign.campaigns.schema.bench import BenchRequestPart
from wil_campaign.campaigns.setup.bench_file import Bench, read_bench
from wil_campaign.foundation.files.documents import Document, parse_document
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.plugins.cluster.bench.bench_messages import FILE, SOCKET_VARIABLE, TEXT
from wil_campaign.plugins.cluster.bench.bench_resources import (
    announced_benches,
    bench_resource_name,
    chosen_bench,
    missing_bench,
)
from wil_campaign.plugins.cluster.node_agent import PipeAgent
from wil_campaign.plugins.cluster.node_messages import ConsentAnswer, ConsentAsked
from wil_campaign.plugins.cluster.ray_agents import HiredAgent, fit_facts
from wil_campaign.plugins.cluster.ray_engine import RayEngine, running_ray
from wil_campaign.plugins.cluster.store import Store


class BenchAgent(PipeAgent):
    """Relays between the machine of a campaign and the server of this bench."""

    def __init__(self) -> None:
        connection = Client(os.environ[SOCKET_VARIABLE], family="AF_UNIX")
        super().__init__(connection, connection)


_POLL_S = 1.0
_REPLY_S = 120.0
"""How long a free bench may take to answer: its node starts a process, which imports first."""


@dataclass(frozen=True, slots=True)
class HiredBench:
    """A bench that is reserved for this campaign until the agent is closed."""

    bench: Bench
    agent: HiredAgent

    def engine(self, store: Store) -> RayEngine:
        """Return the engine that flies on the bench, one run at a time. store: for results."""
        return RayEngine(self.agent.ray, 0, store, self.bench.name, [self.agent])

    def ask_consent(self, asked: ConsentAsked) -> ConsentAnswer:
        """Return the answer of the person at the bench. Raises EngineError."""
        try:
            return asyncio.run(self._ask(asked))
        except (EOFError, OSError) as error:
            raise EngineError(f"bench {self.bench.name} is lost: {error}") from error

    async def _ask(self, asked: ConsentAsked) -> ConsentAnswer:
        await self.agent.send(asked)
        for message in await self.agent.receive():
            if isinstance(message, ConsentAnswer):
                return message
        raise EngineError(f"bench {self.bench.name} sent an unexpected answer", 3)


@contextmanager
def bench_of_cluster(
    address: str, file: Document, request: BenchRequestPart, say: Callable[[str], None]
) -> Iterator[HiredBench]:
    """Join a cluster and reserve the bench that a campaign requests, until the context ends.

    Raises EngineError, and BadInput for a bench that does not appear within `wait_s`.
    """
    with running_ray(address) as ray:
        due_s = time.monotonic() + request.wait_s
        name = await_bench_of_cluster(ray, file, request, say)
        hired = hire_bench(ray, name, max(0.0, due_s - time.monotonic()))
        try:
            yield hired
        finally:
            if not hired.agent.is_dead:
                hired.agent.kill()


def await_bench_of_cluster(
    ray: Any, file: Document, request: BenchRequestPart, say: Callable[[str], None]
) -> str:
    """Return the name of the requested bench, once the cluster has it. Raises BadInput."""
    due_s = time.monotonic() + request.wait_s
    is_waiting = False
    while True:
        there = announced_benches(ray.nodes())
        name = chosen_bench(file, request, there)
        if name is not None:
            return name
        if time.monotonic() >= due_s:
            raise missing_bench(file, request, there)
        if not is_waiting:
            names = ", ".join(sorted(str(bench.facts) for bench in there)) or "none"
            say(f"waiting up to {request.wait_s:g} s for the bench; the cluster has {names}")
            is_waiting = True
        time.sleep(min(_POLL_S, max(0.0, due_s - time.monotonic())))


def hire_bench(ray: Any, name: str, wait_s: float) -> HiredBench:
    """Reserve a bench for a campaign. wait_s: how long to wait while another campaign has it.

    Raises EngineError.
    """
    remote = ray.remote(
        num_cpus=0,
        resources={bench_resource_name(name): 1},
        max_restarts=0,
        max_task_retries=0,
        max_concurrency=8,
    )(BenchAgent)
    actor = remote.remote()
    timeout_s = wait_s + _REPLY_S
    try:
        (messages,) = ray.get([actor.receive.remote(timeout_s)], timeout=timeout_s)
    except ray.exceptions.GetTimeoutError as error:
        ray.kill(actor, no_restart=True)
        raise EngineError(
            f"bench {name} has not answered for {timeout_s:g} s: another campaign flies there, or "
            "its server hangs"
        ) from error
    except ray.exceptions.RayError as error:
        ray.kill(actor, no_restart=True)
        raise EngineError(
            f"bench {name} does not answer: {error}; its server has ended: start it again"
        ) from error
    try:
        facts = fit_facts(messages, f"bench {name}", silent_code=2)
    except EngineError:
        ray.kill(actor, no_restart=True)
        raise
    agent = HiredAgent(ray=ray, actor=actor, node=facts["node"], bench=name)
    return HiredBench(_bench_of(facts), agent)


def _bench_of(facts: dict[str, str]) -> Bench:
    """Return the bench in a node's facts. Raises BadInput with places in the bench's file."""
    name = f"{facts['node']}:{facts[FILE]}"
    return read_bench(parse_document(facts[TEXT].encode(), name=name, path=Path(facts[FILE])))
