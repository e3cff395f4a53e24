"""The battery: drained by the motors' current; its voltage sags and thrust decreases with it."""

from typing import NamedTuple

from wil_campaign.vehicles.embedded.profile import Battery as BatteryProfile

_SECONDS_PER_HOUR = 3600.0
_IDLE_CURRENT_A = 0.3


class BatteryCharge(NamedTuple):
    """The battery's charge as its monitor shows it."""

    voltage_v: float
    current_a: float
    consumed_mah: float
    remaining: float
    """Part of the capacity, 0 to 1."""


class SimulatedBattery:
    """The physics of a battery that is drained in proportion to thrust; empty, it gives none."""

    def __init__(self, *, profile: BatteryProfile, hover_thrust_n: float) -> None:
        self._profile = profile
        self._amperes_per_newton = profile.hover_current_a / hover_thrust_n
        self._used_mah = 0.0
        self.charge = self._battery_reading(0.0)
        """The present reading."""
        self.thrust_factor = self._thrust_factor_now()
        """The thrust at equal throttle, relative to a full battery."""

    @property
    def empty_v(self) -> float:
        """Return the voltage of the empty pack, without a current."""
        return self._profile.empty_v

    def drain(self, thrust_n: float, dt_s: float) -> None:
        """Drain the battery by the motors' current at this collective thrust."""
        current_a = _IDLE_CURRENT_A + thrust_n * self._amperes_per_newton
        self._used_mah += current_a * dt_s / _SECONDS_PER_HOUR * 1000.0
        self.charge = self._battery_reading(current_a)
        self.thrust_factor = self._thrust_factor_now()

    def _thrust_factor_now(self) -> float:
        if self.charge.remaining <= 0.0:
            return 0.0
        return 1.0 - self._profile.thrust_loss * (1.0 - self.charge.remaining)

    def _battery_reading(self, current_a: float) -> BatteryCharge:
        p = self._profile
        remaining = max(0.0, 1.0 - self._used_mah / p.capacity_mah)
        rest_v = p.empty_v + (p.full_v - p.empty_v) * remaining
        return BatteryCharge(
            rest_v - current_a * p.resistance_ohm, current_a, self._used_mah, remaining
        )
