"""The objects of the world that a case's goal or required oracles name."""

from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.safety.oracles.registry import oracle_kinds


def named_objects(case: Case) -> set[str]:
    """Return the objects that the goal or a required oracle of a case names."""
    found = set(case.goal.gates)
    for use in case.oracles:
        if use.parameters.required:
            kind = oracle_kinds()[use.kind]
            found.update(kind.objects(use.parameters, case.world.objects))
    return found
