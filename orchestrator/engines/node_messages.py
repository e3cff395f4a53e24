"""What the machine of a campaign and the process on a node send to each other; picklable."""

from dataclasses import dataclass

from orchestrator.campaign.run_workers import WorkerLost
from orchestrator.engines.travelling_files import TravellingFiles
from orchestrator.model.results import RunResult
from orchestrator.state.run_setup import RunOrder


@dataclass(frozen=True, slots=True)
class CampaignBrought:
    """A campaign comes to a node. folder: of its results, absolute, and the same on every node.

    session: which start of the campaign this is, as the ledger in that folder says.
    """

    folder: str
    session: str
    files: TravellingFiles


@dataclass(frozen=True, slots=True)
class CampaignAnswer:
    """The node has unpacked the campaign; problem: why it cannot fly it, "" where it can."""

    problem: str = ""


@dataclass(frozen=True, slots=True)
class RunOrdered:
    """A run is to be flown on the node."""

    order: RunOrder


@dataclass(frozen=True, slots=True)
class RunEnded:
    """A run on the node has ended. sha256: of its result.json; "" where it wrote none.

    end_text: what was wrong with the end of its process.
    """

    outcome: RunResult | WorkerLost
    sha256: str = ""
    end_text: str = ""
