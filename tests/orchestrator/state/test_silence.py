"""Whether a vehicle is silent: the newest message of each that is still awaited."""

from types import SimpleNamespace
from typing import Any

import pytest

from wil_campaign.orchestrator.state.vehicle_context import is_any_silent


@pytest.mark.parametrize(
    ("received_s", "dropped_out", "silent"),
    [
        ((9.9, 9.8), (), False),
        ((9.9, 9.6), (), True),
        ((9.9, None), (), True),
        ((9.9, 2.0), ("twin",), False),
        ((2.0, 9.9), ("twin",), True),
    ],
)
def test_a_vehicle_that_dropped_out_is_not_awaited(
    received_s: tuple[float | None, ...], dropped_out: tuple[str, ...], silent: bool
) -> None:
    contexts: Any = [
        SimpleNamespace(name=name, driver=SimpleNamespace(state=SimpleNamespace(last_received_s=t)))
        for name, t in zip(("real", "twin"), received_s, strict=True)
    ]
    assert is_any_silent(contexts, dropped_out, 10.0) is silent
