"""Traits of a class of readings: of a plugin's as of ours, checked, recorded, mixed by them."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from wil_campaign.orchestrator.recording.mcap.mcap_bodies import reading_body
from wil_campaign.orchestrator.recording.mcap.mcap_decode import decode_reading_message
from wil_campaign.orchestrator.recording.mcap.mcap_schemas import mcap_schema_texts
from wil_campaign.recipes.model.registry import StepContext, find_step
from wil_campaign.recipes.pipeline.autonomy_readings import without_ground_truth
from wil_campaign.recipes.working import CannotMixError, Masked, element_shape
from wil_campaign.vehicles.readings import kinds
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.vehicles.readings.faults import array_fault, object_ids_fault
from wil_campaign.vehicles.readings.messages import (
    NUMBER,
    encode_message,
    numbers_to_json,
    schema_of_array,
    stamped_message_schema,
)
from wil_campaign.vehicles.readings.numbers import NumbersReading
from wil_campaign.vehicles.readings.traits import ReadingTraits
from wil_campaign.vehicles.sensors.sensor_spec import SensorSpec
from wil_campaign.vehicles.sources.readings.frozen_readings import FrozenReadings
from wil_campaign.worlds.frames import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class EchoReading(NumbersReading):
    """A sonar's echoes. levels: (echoes,) float32. object_ids: (echoes,) uint8, or None."""

    levels: NDArray[np.float32]
    object_ids: NDArray[np.uint8] | None = None


def mismatch(upper: EchoReading, lower: EchoReading) -> str:
    return "" if len(upper.levels) == len(lower.levels) else "echoes differ"


TRAITS = ReadingTraits(
    fault=lambda r: array_fault(r.levels, (None,), np.float32, "echoes"),
    schema=stamped_message_schema("lab.Echoes", levels=schema_of_array(NUMBER)),
    encode=lambda r: ({"levels": numbers_to_json(r.levels)}, None),
    decode=lambda document, _: {"levels": np.array(document["levels"], np.float32)},
    compared=lambda r: (r.levels.tobytes(),),
    elements="levels",
    overlaid=True,
    mismatch=mismatch,
    ground_truth=("object_ids",),
)


def echoes(*levels: float, t_s: float = 1.0) -> Any:
    ids = np.ones(len(levels), np.uint8)
    made = np.array(levels, np.float32)
    return EchoReading(t_s=t_s, arrived_s=t_s, seq=3, source="twin", levels=made, object_ids=ids)


@pytest.fixture(autouse=True)
def _sonar(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    specs = {**kinds.sensor_specs(), "sonar": SensorSpec("sonar", EchoReading, traits=TRAITS)}
    known = (kinds._traits, kinds._names, mcap_schema_texts)
    for each in known:
        each.cache_clear()
    for place in ("vehicles.readings.kinds", "orchestrator.recording.mcap.mcap_decode"):
        monkeypatch.setattr(f"wil_campaign.{place}.sensor_specs", lambda: specs)
    place = "wil_campaign.orchestrator.recording.mcap.mcap_schemas.sensor_specs"
    monkeypatch.setattr(place, lambda: specs)
    yield
    for each in known:
        each.cache_clear()


def test_it_is_checked_and_its_elements_are_counted() -> None:
    assert reading_fault(echoes(1.0, 2.0)) is None
    wrong = EchoReading(t_s=1.0, arrived_s=1.0, seq=0, source="twin", levels=np.zeros((2, 2)))  # type: ignore[arg-type]
    fault = reading_fault(wrong)
    assert fault is not None
    assert fault.kind == "type"
    assert object_ids_fault(np.zeros(3, np.uint8), (2,)) is not None
    assert element_shape(echoes(1.0, 2.0)) == (2,)


@dataclass(frozen=True, slots=True, kw_only=True)
class SoundingReading(NumbersReading):
    """A depth of water. depth_m: metres."""

    depth_m: float


def test_no_other_type_and_no_check_of_its_own_switches_a_check_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lax = ReadingTraits(fault=lambda _: None)
    specs = {
        **kinds.sensor_specs(),
        "other sonar": SensorSpec("other sonar", EchoReading, traits=lax),
        "sounder": SensorSpec("sounder", SoundingReading, traits=lax),
    }
    monkeypatch.setattr("wil_campaign.vehicles.readings.kinds.sensor_specs", lambda: specs)
    kinds._traits.cache_clear()
    assert kinds.traits_of(EchoReading) is TRAITS
    sounding: Any = SoundingReading(
        t_s=1.0, arrived_s=1.0, seq=0, source="twin", depth_m=float("nan")
    )
    fault = reading_fault(sounding)
    assert fault is not None
    assert fault.kind == "not_finite"


def test_it_is_recorded_and_read_back() -> None:
    title, fields, data = reading_body(echoes(0.1, 2.0))
    assert (title, data) == ("lab.Echoes", None)
    assert json.loads(mcap_schema_texts()["lab.Echoes"])["properties"]["levels"]["type"] == "array"
    stamps = {"type": "sonar", "t_s": 1.0, "arrived_s": 1.0, "seq": 3, "source": "twin"}
    again: Any = decode_reading_message(json.loads(encode_message({**fields, "wil": stamps})), {})
    assert isinstance(again, EchoReading)
    assert np.array_equal(again.levels, np.array([0.1, 2.0], np.float32))


def test_it_is_laid_over_another_and_its_objects_are_isolated() -> None:
    laid, kept = find_step("overlay"), find_step("isolate_objects")
    assert laid is not None
    assert kept is not None
    built: Any = laid.build(laid.parameters(), StepContext())
    mask = np.array([255, 0], np.uint8)
    below = echoes(5.0, 6.0)
    made = built({"real": Masked(below), "twin": Masked(echoes(1.0, 2.0), mask)})
    assert made.levels.tolist() == [1.0, 6.0]
    with pytest.raises(CannotMixError, match="overlay: echoes differ"):
        built({"real": Masked(below), "twin": Masked(echoes(1.0))})
    assert TRAITS.overlaid
    for step in (laid, kept):
        assert callable(step.only)
        assert step.only(TRAITS)
    perceived: Any = without_ground_truth(below)
    assert perceived.object_ids is None


def test_it_is_found_frozen() -> None:
    frozen = FrozenReadings()
    found = [frozen.receive(echoes(1.0, t_s=0.1 * k), Pose((0.1 * k, 0.0, 0.0))) for k in range(12)]
    assert found[:9] == [None] * 9
    assert "the sensor is frozen" in str(found[-1])
