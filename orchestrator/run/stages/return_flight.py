"""The return flight to the start between two runs: a run of the real vehicle alone."""

import math
from dataclasses import replace

from wil_campaign.campaigns.expansion.expansion import RunPlan
from wil_campaign.campaigns.schema import RecordPart
from wil_campaign.campaigns.setup.autonomy_under_test import UnderTest
from wil_campaign.campaigns.setup.case_setup import GoalSetup
from wil_campaign.orchestrator.state.return_path import ReturnPath
from wil_campaign.orchestrator.state.run_setup import RunSetup

_RATE_HZ = 20.0


def return_plan(plan: RunPlan) -> RunPlan:
    """Return the plan of a run's return flight, with a name and mode of its own."""
    return replace(plan, case=f"{plan.case}-{plan.mode}-back", mode="real", required=False)


def return_setup(setup: RunSetup, path: ReturnPath) -> RunSetup:
    """Return the setup of a run's return flight, from where the vehicle stands.

    It mixes nothing, has no external I/O and no injected faults; the guard applies the same fence.
    Of observers there is what the vehicle flies by.
    """
    kept = {key: one.on_the_way_back() for key, one in setup.case.observers.items()}
    north_m, east_m, _ = path.start.position_ned_m
    place = {"north_m": north_m, "east_m": east_m, "up_m": path.altitude_m}
    real = replace(setup.case.vehicles["real"], start=path.stand, sensors=())
    campaign = replace(
        setup.case,
        vehicles={"real": real},
        recipe=None,
        under_test=UnderTest(
            use="place",
            folder=setup.case.under_test.folder,
            rate_hz=_RATE_HZ,
            parameters={"speed_m_s": path.speed_m_s, "yaw_deg": math.degrees(path.start.yaw_rad)},
            goal={"altitude_m": path.altitude_m, **place},
        ),
        goal=GoalSetup(altitude_m=path.altitude_m),
        oracles=(),
        record=RecordPart(),
        observers={key: one for key, one in kept.items() if one is not None},
        faults=(),
    )
    return replace(
        setup,
        order=replace(setup.order, plan=return_plan(setup.order.plan)),
        case=campaign,
        vehicles=(real,),
        actors=(),
        profiles={"real": setup.profiles["real"]},
        virtual_scene=setup.real_scene,
    )
