"""The actor of Ray on the node of a bench: passes bytes on to the bench's server and back.

The server is no part of Ray: when this ends, the server's connection does, and the run lands.
"""

import os
from multiprocessing.connection import Client

from orchestrator.engines.bench.bench_messages import SOCKET_VARIABLE
from orchestrator.engines.node_agent import PipeAgent


class BenchAgent(PipeAgent):
    """Relays between the machine of a campaign and the server of this bench."""

    def __init__(self) -> None:
        connection = Client(os.environ[SOCKET_VARIABLE], family="AF_UNIX")
        super().__init__(connection, connection)
