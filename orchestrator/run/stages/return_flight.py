"""A flight back to the start between two runs: a run like others, of the real vehicle alone."""

import math
from dataclasses import replace

from campaigns.expansion.expansion import RunPlan
from campaigns.schema import RecordPart
from campaigns.setup.autonomy_under_test import UnderTest
from campaigns.setup.case_setup import GoalSetup
from campaigns.values.external_setups import ExternalSetup
from orchestrator.model.return_path import ReturnPath
from orchestrator.state.run_setup import RunSetup

_RATE_HZ = 20.0


def return_plan(plan: RunPlan) -> RunPlan:
    """Return a run's plan as that of its return flight: never taken for the run."""
    return replace(plan, case=f"{plan.case}-{plan.mode}-back", mode="real", required=False)


def return_setup(setup: RunSetup, way: ReturnPath) -> RunSetup:
    """Return a run's setup as that of its return flight, from where the vehicle stands.

    It mixes nothing, draws nothing and tells nobody but the guard, which keeps the same fence.
    """
    north_m, east_m, _ = way.start.position_ned_m
    place = {"north_m": north_m, "east_m": east_m, "up_m": way.altitude_m}
    real = replace(setup.campaign.vehicles["real"], start=way.stand, sensors=())
    campaign = replace(
        setup.campaign,
        vehicles={"real": real},
        recipe=None,
        under_test=UnderTest(
            use="place",
            folder=setup.campaign.under_test.folder,
            rate_hz=_RATE_HZ,
            parameters={"speed_m_s": way.speed_m_s, "yaw_deg": math.degrees(way.start.yaw_rad)},
            goal={"altitude_m": way.altitude_m, **place},
        ),
        goal=GoalSetup(altitude_m=way.altitude_m),
        oracles=(),
        links={},
        record=RecordPart(),
        outside=ExternalSetup(),
    )
    return replace(
        setup,
        order=replace(setup.order, plan=return_plan(setup.order.plan)),
        campaign=campaign,
        vehicles=(real,),
        actors=(),
        profiles={"real": setup.profiles["real"]},
        virtual_scene=setup.real_scene,
    )
