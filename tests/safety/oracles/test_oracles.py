import math
from typing import Any

import pytest
from pydantic import ValidationError

from tests.safety.oracles.oracle_rigs import FENCE, SCENE, ScriptedProbe, build
from wil_campaign.safety.oracles.gates import gates_of
from wil_campaign.safety.oracles.oracle import OracleContext
from wil_campaign.safety.oracles.registry import oracle_kinds


def test_registry_names_and_describes_every_oracle() -> None:
    assert set(oracle_kinds()) == {
        "collision", "clearance", "reached", "reached_position", "time_limit", "geofence",
        "altitude", "vehicle_fault", "link", "landed", "twin_divergence", "area", "distance",
        "speed", "attitude", "estimator", "battery", "modes", "touchdown", "encounter",
        "stl",
    }  # fmt: skip
    assert all(spec.summary and spec.name == name for name, spec in oracle_kinds().items())


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("collision", {"colour": "red"}),
        ("clearance", {}),
        ("clearance", {"min_m": 0}),
        ("clearance", {"min_m": math.nan}),
        ("time_limit", {"limit_s": -1}),
        ("altitude", {}),
        ("altitude", {"min_m": 3, "max_m": 2}),
        ("altitude", {"min_m": 2, "max_m": 2}),
        ("link", {"max_gap_s": math.inf}),
        ("landed", {"vehicle": "both"}),
        ("reached", {"direction": "up"}),
        ("speed", {}),
        ("speed", {"min_m_s": 3, "max_m_s": 2}),
        ("speed", {"max_m_s": 2, "axis": "sideways"}),
        ("attitude", {}),
        ("attitude", {"max_tilt_deg": 200}),
        ("battery", {}),
        ("battery", {"min_percent": 20, "min_v": 10}),
        ("battery", {"min_percent": 101}),
        ("estimator", {"max_unsound_s": -1}),
        ("modes", {"allowed": []}),
        ("modes", {"allowed": ["OFFBOARD"]}),
        ("distance", {"object": "person"}),
        ("distance", {"object": "person", "min_m": 5, "max_m": 2}),
        ("altitude", {"max_m": 2, "from": "landed"}),
        ("altitude", {"max_m": 2, "to": "takeoff"}),
        ("altitude", {"max_m": 2, "required": False, "fail_fast": True}),
        ("landed", {"from": "goal"}),
    ],
)
def test_wrong_parameters_are_refused(kind: str, parameters: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        oracle_kinds()[kind].parameters.model_validate(parameters)


NEVER_FED: list[tuple[str, dict[str, Any]]] = [
    ("collision", {}),
    ("clearance", {"min_m": 0.1}),
    ("reached", {}),
    ("reached_position", {"tolerance_m": 0.1}),
    ("time_limit", {"limit_s": 1}),
    ("geofence", {}),
    ("altitude", {"max_m": 2}),
    ("vehicle_fault", {}),
    ("link", {"max_gap_s": 1}),
    ("landed", {}),
    ("twin_divergence", {}),
    ("area", {"keep": {"box": {"north_m": (0, 1), "east_m": (0, 1), "up_m": (0, 1)}}}),
    ("distance", {"object": "gate", "min_m": 1}),
    ("speed", {"max_m_s": 1}),
    ("attitude", {"max_tilt_deg": 30}),
    ("estimator", {}),
    ("battery", {"min_percent": 20}),
    ("modes", {}),
    ("touchdown", {"max_m_s": 1}),
    ("encounter", {"object": "gate", "within_m": 1}),
    ("stl", {"stl": "always (up_m >= 0)"}),
]


@pytest.mark.parametrize(("kind", "parameters"), NEVER_FED)
def test_an_oracle_that_saw_nothing_never_passes_and_says_so(
    kind: str, parameters: dict[str, object]
) -> None:
    context = OracleContext(
        mode="wil",
        subject="real",
        vehicle="real",
        probe=ScriptedProbe({}),
        gates=gates_of(SCENE),
        route=("gate",),
        target_ned_m=(1, 0, -1),
        fence=FENCE,
        things=("gate",),
        probe_of=lambda _: ScriptedProbe({}),
    )
    result = build(kind, context=context, **parameters).result(9.0)
    # A goal that was never seen to be reached is a failure; all else had nothing to judge by.
    never = {"reached", "reached_position", "time_limit"}
    verdict = "FAIL" if kind in never else "INVALID"
    assert (result.verdict, result.actual, result.margin) == (verdict, None, None)
    assert result.detail


def test_every_oracle_is_in_the_test_of_no_samples() -> None:
    assert {kind for kind, _ in NEVER_FED} == set(oracle_kinds()), (
        "NEVER_FED above names each oracle"
    )
