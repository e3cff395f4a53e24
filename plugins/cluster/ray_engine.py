"""The engine that flies runs on a Ray cluster: a local one that it starts, or an existing one."""

import asyncio
import ipaddress
import os
import secrets
import signal
import sys
import sysconfig
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from msgspec import structs

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.orchestrator.campaign.folder.manifest import (
    files_read_by_campaign,
    maybe_written_files,
    naming_documents,
)
from wil_campaign.orchestrator.campaign.folder.named_files import files_in_place, named_files
from wil_campaign.orchestrator.campaign.resuming.cluster_ledger import (
    CampaignPlace,
    RunLedger,
    first_session,
)
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.plugins.cluster.cluster_places import (
    places_by_node,
    shortage_text,
    waiting_text,
)
from wil_campaign.plugins.cluster.head_watch import await_head, watched_head
from wil_campaign.plugins.cluster.node_messages import CampaignAnswer, CampaignBrought
from wil_campaign.plugins.cluster.ray_agents import (
    HIRED_S,
    REPORT_S,
    AgentHire,
    HiredAgent,
    NodeRefusedError,
    hire_agents,
    no_place_text,
)
from wil_campaign.plugins.cluster.ray_worker import RayWorker
from wil_campaign.plugins.cluster.returned_results import (
    FetchedResults,
)
from wil_campaign.plugins.cluster.store import Store, StoreError
from wil_campaign.plugins.cluster.stored_runs import read_session, write_session
from wil_campaign.plugins.cluster.travelling_files import pack_files

_LOOPBACK = "127.0.0.2"
"""Not 127.0.0.1: Ray replaces that by another address of the machine."""
_STORE_BYTES = 80_000_000
"""The least that Ray accepts for its object store; results come by files."""
_UNFIT = 2
"""The exit code for a node that cannot fly for this campaign before it is mended."""
_MOST_REFUSALS = 3
_PAUSE_S, _LONGEST_PAUSE_S = 5.0, 60.0
"""Between tries for another node, of which each starts a process there."""


@dataclass(frozen=True, slots=True)
class RayEngine:
    """Flies runs by agents on nodes. idle: agents that are up and checked, without a run.

    bench: the bench that has the one agent; "" where any node flies. keeps_agents: the same agents
    fly further campaigns. store: for results. places: how many runs are to fly at once, also while
    the cluster has fewer places. reported: the sentences about nodes that the user has seen. flown:
    the nodes that have had a run.
    """

    ray: Any
    cores: int
    store: Store
    bench: str = ""
    idle: list[HiredAgent] = field(default_factory=list)
    keeps_agents: bool = False
    places: int = 1
    reported: set[str] = field(default_factory=set)
    flown: set[str] = field(default_factory=set)

    @property
    def reads_files_here(self) -> bool:
        """Return False: the nodes have copies of the files as they were at the beginning."""
        return False

    def workers(self, campaign: Campaign, folder: Path, say: Callable[[str], None]) -> "RayWorkers":
        """Return the workers of a campaign; its files are copied to their nodes."""
        home, session = folder.absolute(), uuid.uuid4().hex
        try:
            place = self._place(campaign, home, session)
            ledger = RunLedger(home, session, place)
            files = pack_files(
                files_read_by_campaign(campaign), _search_path(), files_named_absolutely(campaign)
            )
        except OSError as error:
            raise EngineError(f"the campaign cannot be sent to the nodes: {error}") from error
        except StoreError as error:
            raise EngineError(f"the store of results is not usable: {error}") from error
        brought = CampaignBrought(home, session, files, place.store, place.place)
        results = FetchedResults(self.store, home, place.place)
        nodes = ", ".join(sorted({hired_agent.node for hired_agent in self.idle}))
        say(f"{len(self.idle)} workers on {nodes}, {len(files.files)} files to copy")
        return RayWorkers(engine=self, brought=brought, ledger=ledger, results=results, say=say)

    def _place(self, campaign: Campaign, folder: Path, session: str) -> CampaignPlace:
        """Return the campaign's place in the store, after writing this start's session there.

        Raises StoreError, OSError.
        """
        first = first_session(folder) or session
        place = CampaignPlace(self.store.url, f"{campaign.name}/{folder.name}-{first[:12]}")
        write_session(self.store, place.place, session)
        if read_session(self.store, place.place) != session:
            raise StoreError(f"{self.store.url} does not return what was just written")
        return place


class RayWorkers:
    """Starts workers on the cluster for one campaign."""

    def __init__(
        self,
        *,
        engine: RayEngine,
        brought: CampaignBrought,
        ledger: RunLedger,
        results: FetchedResults,
        say: Callable[[str], None],
    ) -> None:
        self._engine = engine
        self._say = say
        self._flying = 0
        """How many agents have an order, or are about to get one."""
        self._hiring = 0
        """How many agents are waited for."""
        self._bringing = 0
        """How many agents are sent the campaign."""
        self._refusals = 0
        """How many nodes were refused one after the other."""
        self._freed = asyncio.Event()
        self._brought = brought
        self._ledger = ledger
        self._results = results

    async def start(self) -> RayWorker:
        """Return a worker whose node has the campaign. Raises EngineError.

        A node that is lost or refused is reported, and another one takes its place.
        """
        while True:
            try:
                agent = await self._prepare_agent()
                break
            except NodeRefusedError as error:
                await self._replace_refused(error)
        self._flying += 1
        self._engine.flown.add(agent.node)
        return RayWorker(
            agent=agent,
            ledger=self._ledger,
            results=self._results,
            give_back=self._receive_agent,
            say=self._say,
        )

    async def close(self) -> None:
        """End the agents, unless they are kept for the next campaign."""
        if self._engine.keeps_agents:
            for agent in self._engine.idle:
                agent.has_campaign = False
            return
        agents = list(self._engine.idle)
        self._engine.idle.clear()
        await asyncio.gather(*(agent.close() for agent in agents))

    def _receive_agent(self, agent: HiredAgent) -> None:
        """Take back an agent for the next order, unless it is lost."""
        self._flying -= 1
        self._freed.set()
        if not agent.is_dead:
            self._engine.idle.append(agent)

    async def _prepare_agent(self) -> HiredAgent:
        """Return an agent whose node has the campaign. Raises NodeRefusedError, EngineError."""
        idle = self._engine.idle
        agent = idle.pop() if idle else await self._hire_counted()
        brought = self._brought
        if agent.has_campaign:
            if not brought.files.in_place:
                return agent
            # What it has is compared once more: nothing else sees that a file there has changed.
            brought = structs.replace(brought, files=replace(brought.files, files=()))
        self._bringing += 1
        try:
            await self._bring_campaign(agent, brought)
        except (EOFError, OSError) as error:
            agent.kill()
            raise NodeRefusedError(f"node {agent.node} is lost: {error}") from error
        finally:
            self._bringing -= 1
        self._refusals = 0
        return agent

    async def _replace_refused(self, error: NodeRefusedError) -> None:
        """Return once another agent may be there. Raises EngineError when none is to be expected.

        The cluster may give the same node again and again: after a few times only what still flies
        is waited for, with a try now and then.
        """
        engine = self._engine
        self._refusals += 1
        flies = bool(self._flying or self._bringing or self._hiring or engine.idle)
        # A node that is refused before anything flies has to be mended; one that is lost, not.
        may_try = self._refusals < _MOST_REFUSALS and bool(engine.flown or error.code != _UNFIT)
        if engine.bench or not (flies or may_try):
            raise EngineError(str(error), 3 if engine.flown else error.code) from error
        self._say_once(str(error))
        if not engine.idle and self._refusals > 1:
            self._freed.clear()
            await _is_set(self._freed, min(self._refusals * _PAUSE_S, _LONGEST_PAUSE_S))

    async def _hire_counted(self) -> HiredAgent:
        """Return a further agent, counted while it is waited for. Raises as `_hire_another`."""
        self._hiring += 1
        try:
            return await self._hire_another()
        finally:
            self._hiring -= 1

    async def _hire_another(self) -> HiredAgent:
        """Return a further agent, once there is a place for it.

        The wait lasts as long as other runs fly, and HIRED_S after the last of them. Raises
        NodeRefusedError, EngineError.
        """
        engine = self._engine
        if engine.bench:
            raise EngineError(
                f"bench {engine.bench} is lost and no further runs are flown: check its vehicle, "
                "then start again with --resume"
            )
        hire = AgentHire(engine.ray, engine.cores)
        try:
            await self._await_hire(hire)
        except BaseException:
            hire.dismiss()
            raise
        return hire.agent()

    async def _await_hire(self, hire: AgentHire) -> None:
        """Wait until an agent is up. Raises EngineError."""
        engine, loop = self._engine, asyncio.get_running_loop()
        up = asyncio.Event()

        def wake(_: object) -> None:
            with suppress(RuntimeError):  # the campaign is over
                loop.call_soon_threadsafe(up.set)

        hire.future.add_done_callback(wake)
        due_s = loop.time() + HIRED_S
        while not await _is_set(up, REPORT_S):
            self._say_once(waiting_text(engine.ray.nodes(), engine.cores))
            if self._flying:
                due_s = loop.time() + HIRED_S
            elif loop.time() > due_s:
                raise EngineError(no_place_text(1, engine.cores))

    def _say_once(self, text: str) -> None:
        if text not in self._engine.reported:
            self._engine.reported.add(text)
            self._say(text)

    async def _bring_campaign(self, agent: HiredAgent, brought: CampaignBrought) -> None:
        """Send the campaign's files to a node. Raises NodeRefusedError, EOFError, OSError."""
        await agent.send(brought)
        for message in await agent.receive():
            if isinstance(message, CampaignAnswer) and message.problem:
                agent.kill()
                raise NodeRefusedError(f"node {agent.node}: {message.problem}", _UNFIT)
        agent.has_campaign = True


async def _is_set(event: asyncio.Event, limit_s: float) -> bool:
    with suppress(TimeoutError):
        async with asyncio.timeout(limit_s):
            await event.wait()
    return event.is_set()


def engine_address(text: str) -> str | None:
    """Return the address in `ray://HOST:PORT`; None for `ray`, a local cluster.

    Raises EngineError for another text, and for an address that no token protects.
    """
    if text == "ray":
        return None
    scheme, _, address = text.partition("://")
    host, colon, port = address.rpartition(":")
    if scheme != "ray" or not colon or not host or not port.isdecimal():
        raise EngineError(f"--engine {text}: must be local, ray or ray://HOST:PORT", 2)
    if not _is_loopback(host) and os.environ.get("RAY_AUTH_MODE") != "token":
        raise EngineError(
            f"--engine {text}: a cluster beyond this machine needs a token: start its nodes and "
            "this program with RAY_AUTH_MODE=token and the same RAY_AUTH_TOKEN",
            2,
        )
    return address


@contextmanager
def ray_engine(
    address: str | None,
    *,
    jobs: int | None,
    cores: int,
    store: Store,
    keeps_agents: bool = False,
    say: Callable[[str], None] = lambda _: None,
) -> Iterator[RayEngine]:
    """Start a local Ray for `jobs` runs, or join the one at an address.

    jobs: None for as many as the cluster has place for. cores: the CPUs that a run takes.
    keeps_agents: for several campaigns, one after the other. store: of results. say: called with
    what is waited for, and where fewer runs fly at once. Raises EngineError.
    """
    with running_ray(address, cpus=(jobs or 1) * cores) as ray:
        there = sum(places_by_node(ray.nodes(), cores).values())
        count = jobs or max(1, there)
        if shortage := shortage_text(ray.nodes(), count, cores):
            say(f"{shortage}; the others fly as soon as there is place for them")
        agents = hire_agents(ray, min(count, max(1, there)), cores=cores, say=say)
        yield RayEngine(ray, cores, store, idle=agents, keeps_agents=keeps_agents, places=count)


@contextmanager
def running_ray(address: str | None, *, cpus: int = 0) -> Iterator[Any]:
    """Return the module ray, connected to a local Ray with `cpus`, or to an address.

    Called in the main thread, with whose end the processes of a local Ray end. Raises EngineError.
    """
    if address is None:
        os.environ.update(RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=_own_token())
        # Ray sets the niceness of its workers to 15; a flight needs 0.
        os.environ.update(RAY_worker_niceness="0")
    os.environ.update(RAY_DEDUP_LOGS="0", RAY_USAGE_STATS_ENABLED="0")
    ray = _import_ray()
    before = signal.getsignal(signal.SIGTERM)
    try:
        if address is None:
            _start(ray, cpus)
        else:
            _join(ray, address)
        signal.signal(signal.SIGTERM, before)  # Ray's handler would end this program in flight
        with nullcontext() if address is None else watched_head(address):
            yield ray
    finally:
        ray.shutdown()
        signal.signal(signal.SIGTERM, before)


def _start(ray: Any, cpus: int) -> None:
    """Start a local Ray. Raises EngineError."""
    try:
        ray.init(
            address="local",
            num_cpus=cpus,
            num_gpus=0,
            include_dashboard=False,
            object_store_memory=_STORE_BYTES,
            _node_ip_address=_LOOPBACK,
            log_to_driver=False,
            logging_level="ERROR",
        )
    except (OSError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
        raise EngineError(f"Ray cannot be started on this machine: {error}") from error


def _join(ray: Any, address: str) -> None:
    """Join a cluster, of which this machine must be a node. Raises EngineError."""
    if not await_head(address):
        raise EngineError(
            f"no head of a Ray cluster answers at {address}: start it with ray start --head, or "
            "correct --engine"
        )
    try:
        ray.init(address=address, log_to_driver=False, logging_level="ERROR")
    except (OSError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
        raise EngineError(
            f"cannot join the Ray cluster at {address}: {error}; this machine must be a node of "
            f"it: ray start --address={address}, with the same versions of Ray and Python"
        ) from error


def _import_ray() -> Any:
    """Return the module ray. Raises EngineError where the extra is not installed."""
    try:
        import ray  # noqa: PLC0415  # of an extra
        import ray.exceptions  # noqa: PLC0415
    except ImportError as error:
        raise EngineError(
            "--engine ray needs the extra cluster: pip install 'wil-campaign[cluster]'", 2
        ) from error
    return ray


@cache
def _own_token() -> str:
    """Return the token of each local Ray; Ray reads the token once in a process."""
    return secrets.token_hex(32)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def files_named_absolutely(campaign: Campaign) -> Iterator[tuple[Path, Path]]:
    """Yield the files that a campaign names absolutely, as named and as here.

    Except those of its benches: their names mean files of the bench's machine, whatever is here.
    And except what a flight may write.
    """
    documents = [bench.document for bench in campaign.benches]
    excepted = {path for one in documents for path in named_files(one.data, one.path)}
    excepted |= maybe_written_files(campaign)
    for document in naming_documents(campaign):
        for name, path in files_in_place(document.data, document.path):
            if path not in excepted:
                yield name, path


def _search_path() -> list[str]:
    """Return the folders from which this process imports, without those of installed packages."""
    installed = {
        sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")
    }
    return [entry for entry in sys.path if entry not in installed]
