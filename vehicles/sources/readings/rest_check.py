"""Checks the readings of a vehicle at rest for wrong units and axes, before arming; pure.

At rest the right values are known closely, and a wrong unit is a factor of nine at the least (g
for m/s2), a wrong axis a quarter of a turn.
"""

from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.readings.kinds import traits_of
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.geodesy import LocalFrame


def rest_fault(reading: Reading, *, pose: Pose, frame: LocalFrame) -> str | None:
    """Return what is wrong with a reading of a vehicle at rest, in words; None for nothing.

    pose: of the vehicle in the world, from the source that judges it. frame: of the world on earth.
    """
    check = traits_of(type(reading)).at_rest
    return None if check is None else check(reading, pose, frame)
