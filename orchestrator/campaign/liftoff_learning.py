"""Learns from a campaign's runs how long each vehicle takes from takeoff command to liftoff."""

from collections.abc import Mapping
from dataclasses import replace

from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.orchestrator.run.stages.liftoff_delays import LiftoffDelays
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder


class LiftoffLearning:
    """Adds the liftoff delays that earlier runs measured to each order; not in virtual time.

    There a run must not depend on which runs were flown before it.
    """

    def __init__(self, campaign: Campaign, clock: Clock) -> None:
        self._campaign = campaign
        self._learns = clock != "virtual"
        self._delays = LiftoffDelays()

    def ready(self, order: RunOrder) -> RunOrder:
        """Return an order with the liftoff delays known by now."""
        if not self._learns:
            return order
        known = {name: self._delays.of(key) for name, key in self._keys(order.plan).items()}
        delays_s = {name: delay_s for name, delay_s in known.items() if delay_s is not None}
        return replace(order, liftoff_delays_s=delays_s)

    def learn(self, plan: RunPlan, result: RunResult) -> None:
        """Learn from the result of a run of the pair.

        A vehicle that flies alone gets its takeoff command as soon as it is armed, so that its
        delay includes the spin-up of its motors; a pair waits for that before its commands.
        """
        keys = self._keys(plan)
        if len(keys) < 2:
            return
        for name, delay_s in result.sync.liftoff_delays_s.items():
            self._delays.record(keys[name], delay_s)

    def _keys(self, plan: RunPlan) -> Mapping[str, str]:
        """Return by vehicle name the key of its liftoff delays."""
        setup = self._campaign.setups[plan.case]
        vehicles = [setup.vehicles[name] for name in setup.flying(plan.mode)]
        return {
            vehicle.name: f"{vehicle.name} {vehicle.autopilot} {vehicle.link}"
            for vehicle in vehicles
        }
