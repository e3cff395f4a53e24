"""The objects of the world that a case's goal or required oracles name."""

from wil_campaign.campaigns.setup.case_setup import Setup
from wil_campaign.safety.oracles.registry import oracle_kinds


def named_objects(setup: Setup) -> set[str]:
    """Return the objects that the goal or a required oracle of a case names."""
    found = set(setup.goal.gates)
    for use in setup.oracles:
        if use.parameters.required:
            kind = oracle_kinds()[use.kind]
            found.update(kind.objects(use.parameters, setup.world.objects))
    return found
