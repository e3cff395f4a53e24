"""What the runs of a campaign teach about how long its vehicles take to leave the ground."""

from collections.abc import Mapping
from dataclasses import replace

from campaigns.expansion.expansion import Campaign, RunPlan
from orchestrator.model.clock import Clock
from orchestrator.model.liftoff_delays import LiftoffDelays
from orchestrator.model.results import RunResult
from orchestrator.state.run_setup import RunOrder


class LiftoffLearning:
    """Gives each order what the runs before it measured; under virtual time nothing.

    There a run must not depend on those that happened to be flown before.
    """

    def __init__(self, campaign: Campaign, clock: Clock) -> None:
        self._campaign = campaign
        self._learns = clock != "virtual"
        self._delays = LiftoffDelays()

    def ready(self, order: RunOrder) -> RunOrder:
        """Return an order with what is known by now."""
        if not self._learns:
            return order
        known = {name: self._delays.of(key) for name, key in self._keys(order.plan).items()}
        delays_s = {name: delay_s for name, delay_s in known.items() if delay_s is not None}
        return replace(order, liftoff_delays_s=delays_s)

    def learn(self, plan: RunPlan, result: RunResult) -> None:
        """Take the result of a run of the pair.

        Who flies alone is commanded as soon as it is armed: what it takes has its motors' time in
        it, for which a pair waits before its commands.
        """
        keys = self._keys(plan)
        if len(keys) < 2:
            return
        for name, delay_s in result.sync.liftoff_delays_s.items():
            self._delays.take(keys[name], delay_s)

    def _keys(self, plan: RunPlan) -> Mapping[str, str]:
        """Return by name what tells a vehicle of this campaign from others."""
        setup = self._campaign.setups[plan.case]
        vehicles = [setup.vehicles[name] for name in setup.flying(plan.mode)]
        return {one.name: f"{one.name} {one.autopilot} {one.link}" for one in vehicles}
