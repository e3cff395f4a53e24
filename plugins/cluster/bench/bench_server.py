"""The server of a bench: accepts one campaign at a time, and starts a node process to fly it.

It is an ordinary program on the bench's machine and terminal, outside of Ray. Its node processes
land their run when it ends, or when the cluster does.

What a bench accepts: orders for its own vehicle, as many as its operator consented to; pure.

Messages from the network pass this check before they reach anything that flies.
"""

import os
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Client, Connection, Listener

from wil_campaign.campaigns.setup.bench_file import Bench
from wil_campaign.campaigns.setup.bench_resolution import bench_departure
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.plugins.cluster.bench.bench_messages import FILE, TEXT
from wil_campaign.plugins.cluster.node_agent import NodeAgent
from wil_campaign.plugins.cluster.node_messages import (
    CommandSent,
    ConsentAnswer,
    ConsentAsked,
    DamagedMessageError,
    NodeFacts,
    RunEnded,
    RunOrdered,
    ToNode,
    decode_to_campaign,
    decode_to_node,
    encode_to_campaign,
    encode_to_node,
)
from wil_campaign.safety.guard.core.operator_command import OperatorCommand


class BenchGate:
    """Counts the flights of one campaign that a person at the bench has consented to."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._consented: ConsentAsked | None = None
        self._flown = 0

    def open_for(self, asked: ConsentAsked) -> None:
        """Accept a person's consent; it replaces an earlier one."""
        self._consented, self._flown = asked, 0

    def refusal(self, message: ToNode) -> str:
        """Return why a message is not passed on to the bench's runs; "" where it is.

        A flight back to the start belongs to the run before it.
        """
        if not isinstance(message, RunOrdered):
            return ""
        order, consented = message.order, self._consented
        if consented is None:
            return f"nobody at bench {self._bench.name} has consented to this campaign"
        if order.arm and not consented.arm:
            return f"bench {self._bench.name} has consent for a campaign that does not arm"
        if order.back is None:
            self._flown += 1
            if self._flown > consented.runs:
                return f"bench {self._bench.name} has consent for {consented.runs} runs, not more"
        return bench_departure(order.plan.files.campaign, self._bench)


_POLL_S = 1.0
_RELAYED_S = 10.0
"""How long a campaign's machine that stands still may keep the last messages from being relayed."""


class BenchServer:
    """Serves a bench to a cluster. consent: asks the person at the bench; say: shows a sentence."""

    def __init__(
        self,
        bench: Bench,
        *,
        consent: Callable[[ConsentAsked], ConsentAnswer],
        say: Callable[[str], None],
    ) -> None:
        self._bench = bench
        self._consent = consent
        self._say = say
        self._stopped = threading.Event()

    def serve(self, listener: Listener) -> None:
        """Serve one connection after the other, until `stop`.

        Raises EngineError for a damaged message, after the landing.
        """
        while True:
            with listener.accept() as connection:
                if self._stopped.is_set():
                    return
                self.serve_campaign(connection)

    def stop(self, socket: str) -> None:
        """End `serve` once no campaign is served; called in another thread."""
        self._stopped.set()
        with suppress(OSError), Client(socket, family="AF_UNIX"):
            pass  # the connection wakes `serve`

    def serve_campaign(self, connection: Connection) -> None:
        """Serve one campaign until its connection ends and its vehicles have landed.

        Raises EngineError for a damaged message, after the landing.
        """
        node = NodeAgent()
        lock = threading.Lock()

        def reply(content: bytes) -> None:
            with lock, suppress(OSError):  # the campaign's machine has closed the connection
                connection.send_bytes(content)

        relay = threading.Thread(target=self._relay_replies, args=(node, connection, reply))
        relay.start()
        gate = BenchGate(self._bench)
        try:
            while True:
                content = connection.recv_bytes()
                self._handle(decode_to_node(content), content, gate, node, reply)
        except DamagedMessageError as error:
            raise EngineError(
                f"bench {self._bench.name}: a message of the cluster is damaged, and vehicles in "
                f"flight have landed: {error}; install the same wheel of wil-campaign[cluster] "
                "with the same constraints on the machine of the campaign, then start "
                "`bench serve` again"
            ) from error
        except (EOFError, OSError):
            pass
        except KeyboardInterrupt:
            abort = OperatorCommand("abort", f"Ctrl-C at the terminal of bench {self._bench.name}")
            with suppress(OSError):
                node.send(encode_to_node(CommandSent(abort)))
            raise
        finally:
            self._await_landing(node, relay, connection)

    def _await_landing(
        self, node: NodeAgent, relay: threading.Thread, connection: Connection
    ) -> None:
        """Wait until what flies has landed, also at a further Ctrl-C, which ends the server then.

        Raises KeyboardInterrupt.
        """
        is_interrupted = False
        while True:
            try:
                node.close()
                relay.join(_RELAYED_S)
                _shut(connection)
                relay.join()
                break
            except KeyboardInterrupt:
                is_interrupted = True
                self._say("still landing; the program ends when the vehicles are down")
        self._say(f"bench {self._bench.name} is free")
        if is_interrupted:
            raise KeyboardInterrupt

    def _handle(
        self,
        message: ToNode,
        content: bytes,
        gate: BenchGate,
        node: NodeAgent,
        reply: Callable[[bytes], None],
    ) -> None:
        """Answer a message, or relay its content to the node process."""
        if isinstance(message, ConsentAsked):
            answer = self._consent(message)
            if not answer.problem:
                gate.open_for(message)
            reply(encode_to_campaign(answer))
        elif refusal := gate.refusal(message):
            self._say(f"refused: {refusal}")
            reply(encode_to_campaign(RunEnded.of(WorkerLost(refusal))))
        else:
            node.send(content)

    def _relay_replies(
        self, node: NodeAgent, connection: Connection, reply: Callable[[bytes], None]
    ) -> None:
        """Relay the node process's messages until it ends; the bench's file joins its facts."""
        with suppress(EOFError, OSError):  # a damaged message ends the campaign, too
            while True:
                for content in node.receive(_POLL_S):
                    message = decode_to_campaign(content)
                    if isinstance(message, NodeFacts):
                        content = encode_to_campaign(self._with_file(message))  # noqa: PLW2901
                    reply(content)
        _shut(connection)

    def _with_file(self, message: NodeFacts) -> NodeFacts:
        document = self._bench.document
        lines = document.root.place.source.lines
        file = {TEXT: "\n".join(lines), FILE: str(document.path.absolute())}
        return NodeFacts({**message.facts, **file})


def _shut(connection: Connection) -> None:
    """Shut down a connection that another thread reads from or writes to."""
    with suppress(OSError), socket.socket(fileno=os.dup(connection.fileno())) as one:
        one.shutdown(socket.SHUT_RDWR)
