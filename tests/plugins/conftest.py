"""For tests of plugins: fixtures of campaigns, flights and vehicles, which are explained there."""

from tests.campaigns.conftest import files  # noqa: F401 - a fixture
from tests.orchestrator.conftest import (  # noqa: F401 - fixtures
    fly_run,
    fork_server,
    forked_workers,
    patient_logs,
)
from tests.vehicles.conftest import fake_pair  # noqa: F401 - a fixture
from tests.vehicles.links.conftest import (  # noqa: F401 - fixtures
    free_tcp_port,
    inbox,
    wait_until,
)
