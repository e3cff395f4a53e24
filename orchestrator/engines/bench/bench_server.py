"""The server of a bench: takes one campaign at a time, and has a node's process fly it.

It is an ordinary program on the bench's machine and terminal, outside of Ray. What flies are the
processes that it starts; they land when it ends, or when the cluster does.
"""

import os
import pickle
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Client, Connection, Listener

from campaigns.setup.bench_file import Bench
from orchestrator.campaign.workers.run_engine import EngineError
from orchestrator.campaign.workers.run_workers import WorkerLost
from orchestrator.engines.bench.bench_gate import BenchGate
from orchestrator.engines.bench.bench_messages import FILE, TEXT, ConsentAnswer, ConsentAsked
from orchestrator.engines.node_agent import NodeAgent
from orchestrator.engines.node_messages import (
    CampaignBrought,
    DamagedMessageError,
    RunEnded,
    RunOrdered,
    RunTaken,
    read_message,
)
from orchestrator.state.run_setup import RunOrder
from safety.guard.core.operator_command import OperatorCommand

_LOOK_S = 1.0
_OF_CAMPAIGN = (ConsentAsked, CampaignBrought, RunOrdered, RunTaken, OperatorCommand)
"""What the machine of a campaign sends."""


class BenchServer:
    """Serves a bench to a cluster. consent: asks the person at the bench.

    say: shows that person a sentence.
    """

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

        Raises EngineError for a message that is damaged, when all has landed.
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
            pass  # whoever waits for a connection has one

    def serve_campaign(self, connection: Connection) -> None:
        """Serve one campaign until its connection ends; then all it flies has landed.

        Raises EngineError for a message that is damaged, after that.
        """
        node = NodeAgent()
        lock = threading.Lock()

        def reply(message: object) -> None:
            with lock, suppress(OSError):  # nobody is there any more
                connection.send_bytes(pickle.dumps(message))

        passing = threading.Thread(target=self._pass_back, args=(node, connection, reply))
        passing.start()
        gate = BenchGate(self._bench)
        try:
            while True:
                content = connection.recv_bytes()
                self._take(_read(content), content, gate, node, reply)
        except DamagedMessageError as error:
            raise EngineError(
                f"bench {self._bench.name}: a message of the cluster is damaged, and what flew has "
                f"landed: {error}; see that the machine of the campaign has the same wheel of "
                "wil-campaign[cluster] with the same constraints, and start it again"
            ) from error
        except (EOFError, OSError):
            pass
        except KeyboardInterrupt:
            said = OperatorCommand("abort", f"Ctrl-C at the terminal of bench {self._bench.name}")
            with suppress(OSError):
                node.send(pickle.dumps(said))
            raise
        finally:
            node.close()
            passing.join()
            self._say(f"bench {self._bench.name} is free")

    def _take(
        self,
        message: object,
        content: bytes,
        gate: BenchGate,
        node: NodeAgent,
        reply: Callable[[object], None],
    ) -> None:
        """Answer a message, or pass its content on to the process that flies."""
        if isinstance(message, ConsentAsked):
            answer = self._consent(message)
            if not answer.problem:
                gate.open_for(message)
            reply(answer)
        elif refusal := gate.refusal(message):
            self._say(f"refused: {refusal}")
            reply(RunEnded(WorkerLost(refusal)))
        else:
            node.send(content)

    def _pass_back(
        self, node: NodeAgent, connection: Connection, reply: Callable[[object], None]
    ) -> None:
        """Pass what the process says on, its facts with the bench's file, until it ends."""
        with suppress(EOFError, OSError):  # what is damaged ends the campaign, as its end does
            while True:
                for content in node.receive(_LOOK_S):
                    message = read_message(content)
                    reply(self._with_file(message) if isinstance(message, dict) else message)
        _shut(connection)

    def _with_file(self, facts: dict[str, str]) -> dict[str, str]:
        """Return the facts of a node with its bench's file."""
        document = self._bench.document
        lines = document.root.place.source.lines
        return {**facts, TEXT: "\n".join(lines), FILE: str(document.path.absolute())}


def _read(content: bytes) -> object:
    """Return the message of a campaign's machine. Raises DamagedMessageError."""
    message = read_message(content)
    if isinstance(message, RunOrdered) and not isinstance(message.order, RunOrder):
        raise DamagedMessageError(f"an order is a {type(message.order).__name__}")
    if not isinstance(message, _OF_CAMPAIGN):
        raise DamagedMessageError(f"{type(message).__name__} is no message of a campaign")
    return message


def _shut(connection: Connection) -> None:
    """End a connection that another thread reads from."""
    with suppress(OSError), socket.socket(fileno=os.dup(connection.fileno())) as one:
        one.shutdown(socket.SHUT_RDWR)
