"""The objects of the world that a case's goal or required oracles name."""

import re

from campaigns.setup.case_setup import Setup
from safety.oracles.distance import DistanceParameters
from safety.oracles.reached import ReachedParameters
from safety.oracles.stl import StlParameters
from safety.oracles.stl_signals import distance_name


def named_objects(setup: Setup) -> set[str]:
    """Return the objects that the goal or a required oracle of a case names."""
    found = set(setup.goal.gates)
    for use in setup.oracles:
        match use.parameters:
            case ReachedParameters(required=True, gates=tuple() as gates):
                found.update(gates)
            case DistanceParameters(required=True, object=name):
                found.add(name)
            case StlParameters(required=True, stl=formula):
                words = set(re.findall(r"\w+", formula))
                found.update(one for one in setup.world.objects if distance_name(one) in words)
    return found
