"""A share of the flights that must fail by faults of the field; the bench flies hundreds."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.faults import lost_parts
from tests.faults.field_faults import POSSIBLE, draw_field, inject_field
from tests.faults.ground_station import TAKES_OVER
from tests.faults.missions import Cause
from tests.faults.signals import SignalFault
from tests.faults.wire_changes import OTHERS
from wil_campaign.orchestrator.state.run_state import Stage
from wil_campaign.plugins.meshes.mesh_reader import Z_UP, load_mesh_shape


def fault_of(signal: str, kind: str, cause: Cause, stage: Stage = "goal") -> SignalFault:
    drawn = draw_field(0)
    return replace(
        drawn, signal=signal, cause=cause, mode="sim", vehicle="twin", autopilot="px4",
        judged_by="mavlink", lone=True, stage=stage, after_s=0.5,
        alteration=replace(drawn.alteration, kind=kind, offset_m=(0.5, 0.5, 0.5)),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("signal", "kind", "verdict", "said"),
    [
        ("estimator's hold", "dead reckoning", "INVALID", "dead reckoning from then on"),
        ("second sender", "flies along, numbered anew", "INVALID", "by two clocks"),
        ("ground station", "sticks", "INVALID", "sends positions of sticks to twin"),
        ("ground station", "mode", "ABORTED", "took twin over by MAV_CMD_NAV_LAND"),
    ],
)
def test_a_sound_flight_with_a_fault_of_the_field_is_no_pass(
    tmp_path: Path, signal: str, kind: str, verdict: str, said: str
) -> None:
    outcome = inject_field(fault_of(signal, kind, "none"), tmp_path / "flight")
    assert (outcome.verdict, outcome.wrong) == (verdict, False)
    assert said in outcome.reason


@pytest.mark.parametrize("kind", ["companion", "text"])
def test_messages_of_a_second_sender_hide_no_wall(tmp_path: Path, kind: str) -> None:
    outcome = inject_field(fault_of("second sender", kind, "wall"), tmp_path / "flight")
    assert (outcome.verdict, outcome.reason) == ("FAIL", "twin touched wall.box")


@pytest.mark.parametrize(("kind", "stage"), [("parameters", "identify"), ("estimate", "goal")])
def test_changes_by_a_ground_station_do_not_arrive_in_a_sound_flight(
    tmp_path: Path, kind: str, stage: Stage
) -> None:
    outcome = inject_field(fault_of("ground station", kind, "none", stage), tmp_path / "flight")
    assert (outcome.verdict, outcome.exempt) == ("PASS", True)


def triangles(path: Path, how: str, size_m: Sequence[float]) -> tuple[int, float]:
    """Return how many triangles a written file has, and how far back the nearest is, in m."""
    name, data = lost_parts.mesh_file(how, size_m, 1.0)
    (path / name).write_bytes(data)
    mesh = load_mesh_shape(path / name, unit="m", axes=Z_UP).mesh
    return len(mesh.faces), round(float(np.min(mesh.vertices_m[mesh.faces][..., 0])), 3)


@pytest.mark.parametrize("how", lost_parts.WHOLE)
def test_the_meshes_that_lose_a_part_have_it_in_the_way_before(tmp_path: Path, how: str) -> None:
    assert triangles(tmp_path, how, [0.1, 6, 4]) == (24, -0.05)


@pytest.mark.parametrize("how", lost_parts.LOST)
def test_a_part_that_is_lost_is_refused_or_nothing_says_that_it_was_there(
    tmp_path: Path, how: str
) -> None:
    fault = replace(fault_of("mesh", how, "wall"), after_s=0.47)
    outcome = inject_field(fault, tmp_path / "flight")
    assert not outcome.wrong
    # Nothing in these two says that more was meant.
    assert outcome.exempt == (how in {"solid cut", "obj cut"})
    assert outcome.exempt or outcome.verdict == "refused"


def test_the_faults_are_those_of_the_seed_and_cover_all_kinds() -> None:
    assert draw_field(7) == draw_field(7)
    drawn = [draw_field(seed) for seed in range(1500)]
    assert {(one.signal, one.kind) for one in drawn} == {
        (signal, kind) for signal, kinds in POSSIBLE.items() for kind in kinds
    }
    assert all(one.vehicle == one.subject for one in drawn)
    sound = [one for one in drawn if one.cause == "none"]
    assert len(drawn) / 4 < len(sound) < len(drawn) / 2
    # Of a sound flight a wrong heading proves nothing where the estimate is judged.
    assert {one.judged_by for one in sound if one.signal == "heading"} == {"mavlink"}
    spared = [one for one in sound if one.kind in OTHERS or one.signal == "ground station"]
    assert sum(one.kind not in TAKES_OVER for one in spared) < len(drawn) / 8
