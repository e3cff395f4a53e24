"""A pair's stages: armed alone, and at its height once it has stayed there."""

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.run.stages.pair_flight import _arm, _at_height, _await_disarmed
from wil_campaign.orchestrator.state.run_state import FlightError
from wil_campaign.vehicles.driver.vehicle_state import StatusText
from wil_campaign.vehicles.errors import VehicleError

SYNC: Any = SimpleNamespace(takeoff_timeout_s=8.0, takeoff_tolerance_m=0.1)
HEIGHT_M = 1.5
Height = Callable[[float], float | None]


Armed = Callable[[float], bool]


def seen_at_height_s(height_m: Height, is_armed: Armed = lambda _: True) -> float:
    async def wait() -> float:
        loop = asyncio.get_running_loop()
        began_s = loop.time()

        class Driver:
            @property
            def state(self) -> Any:
                armed = is_armed(loop.time() - began_s)
                texts = (StatusText(1.0, 6, "Disarmed by auto preflight disarming"),)
                return SimpleNamespace(armed=armed, texts=texts)

        context: Any = SimpleNamespace(
            name="real", height_m=lambda: height_m(loop.time() - began_s), driver=Driver()
        )
        await _at_height(context, HEIGHT_M, SYNC)
        return loop.time() - began_s

    return run_virtual(wait())


def passing_through(t_s: float) -> float:
    """Climb at 1 m/s to 2.5 m, through the height at 1.5 s, and come back for good at 4 s."""
    return min(t_s, 2.5) if t_s < 4.0 else HEIGHT_M


def unknown_between(t_s: float) -> float | None:
    return None if 0.2 < t_s < 1.0 else HEIGHT_M


@pytest.mark.parametrize(
    ("height_m", "at_s"),
    [(lambda _: HEIGHT_M + 0.09, 0.5), (passing_through, 4.5), (unknown_between, 1.5)],
)
def test_a_vehicle_is_at_its_height_when_it_has_stayed_there(height_m: Height, at_s: float) -> None:
    assert seen_at_height_s(height_m) == pytest.approx(at_s, abs=0.05)


@pytest.mark.parametrize(
    ("height_m", "where"), [(lambda _: HEIGHT_M - 0.11, "1.39 m"), (lambda _: None, "unknown")]
)
def test_a_vehicle_that_never_reaches_its_height_ends_the_takeoff(
    height_m: Height, where: str
) -> None:
    with pytest.raises(FlightError, match=f"not at 1.5 m within 8 s .*its height is {where}"):
        seen_at_height_s(height_m)


def test_a_vehicle_that_disarms_in_its_takeoff_ends_it_soon_with_its_reason() -> None:
    """The other vehicle hovered for the rest of the time-out, and the reason was a height."""
    said = "real: it is disarmed, and not at 1.5 m; its height is 0.00 m; its last STATUSTEXT: Disa"
    with pytest.raises(FlightError, match=said):
        seen_at_height_s(lambda _: 0.0, lambda t_s: t_s < 2.0)
    began_s = seen_at_height_s(passing_through, lambda t_s: not 2.0 < t_s < 3.0)
    assert began_s == pytest.approx(4.5, abs=0.05), "a heartbeat of before"


@pytest.mark.parametrize(
    ("disarmed_s", "silent_s", "awaited_s"), [(5.0, 99.0, 5.0), (99.0, 1.0, 4.0), (99.0, 99.0, 8.0)]
)
def test_a_dropped_out_vehicle_is_awaited_until_it_is_disarmed_or_silent(
    disarmed_s: float, silent_s: float, awaited_s: float
) -> None:
    class Driver:
        @property
        def state(self) -> Any:
            now_s = asyncio.get_running_loop().time()
            return SimpleNamespace(armed=now_s < disarmed_s, last_received_s=min(now_s, silent_s))

    async def wait() -> float:
        context: Any = SimpleNamespace(driver=Driver())
        sync: Any = SimpleNamespace(landing_timeout_s=8.0)
        await _await_disarmed([context], sync)
        return asyncio.get_running_loop().time()

    assert run_virtual(wait()) == pytest.approx(awaited_s, abs=0.05)


@pytest.mark.parametrize("at_s", [0.5, None])
@pytest.mark.parametrize("names", [("twin",), ("real", "twin")])
def test_no_vehicle_takes_off_when_a_second_one_appears_after_arming(
    names: tuple[str, ...], at_s: float | None
) -> None:
    """It is armed at 0.6 s by its heartbeat; of a pair the motors spool up then."""

    class Driver:
        identity = SimpleNamespace(autopilot="px4")

        async def arm(self) -> None:
            await asyncio.sleep(0.6)

        def require_alone(self) -> None:
            if at_s is not None and asyncio.get_running_loop().time() >= at_s:
                raise VehicleError("two vehicles have the system id 2")

    contexts: Any = tuple(SimpleNamespace(name=name, driver=Driver()) for name in names)
    if at_s is None:
        run_virtual(_arm(contexts))
    else:
        with pytest.raises(VehicleError, match="two vehicles"):
            run_virtual(_arm(contexts))
