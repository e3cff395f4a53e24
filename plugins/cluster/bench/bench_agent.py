"""The Ray actor on the node of a bench: relays bytes to and from the bench's server.

The server is no part of Ray: when the actor ends, its connection ends, and the run lands.
"""

import os
from multiprocessing.connection import Client

from wil_campaign.plugins.cluster.bench.bench_messages import SOCKET_VARIABLE
from wil_campaign.plugins.cluster.node_agent import PipeAgent


class BenchAgent(PipeAgent):
    """Relays between the machine of a campaign and the server of this bench."""

    def __init__(self) -> None:
        connection = Client(os.environ[SOCKET_VARIABLE], family="AF_UNIX")
        super().__init__(connection, connection)
