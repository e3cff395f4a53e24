"""Compile the kernels that flights use, once: `python -m tests.kernels` before many workers start.

Each of them compiles otherwise what it finds missing, all the same at the same time.
"""

from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.run.perception.warm_up import warm_up
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup

_ROOT = Path(__file__).parents[1]


def main() -> None:
    options = ExpansionOptions(cases=("large",), modes=("wil",))
    plan = load_campaign(_ROOT / "campaigns" / "gate.yaml", options).runs[0]
    warm_up(RunSetup.of(RunOrder(plan=plan, folder=Path(), clock="virtual")))


if __name__ == "__main__":
    main()
