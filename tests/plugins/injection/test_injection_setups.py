"""What a campaign may say of injections."""

from typing import Any

import pytest

from tests.campaigns.conftest import Files
from tests.campaigns.setup.test_external_setups import REAL, TWIN, needs, setup
from wil_campaign.plugins.injection.injection_setups import InjectionSetup, InjectionSetups


def test_obstacles_for_px4_are_refused_before_anything_is_there(files: Files) -> None:
    lidar = "      lidar: {type: lidar}\n"
    files.change(REAL, REAL + lidar)
    files.change(TWIN, TWIN + lidar)
    files.append("inject: {obstacle_distance: {sensor: lidar}}\n")
    unmixed = [f"the recipe mixes no 'lidar' for '{name}'" for name in ("real", "twin")]
    assert [one for one in unmixed if any(one in fault for fault in files.faults())] == unmixed
    files.change("sensors: {camera", "sensors: {lidar: {type: lidar}, camera", file="recipe.yaml")
    mixed = "combine:\n  - {sensor: lidar, merge: {aggregate: {by: min}}}\n"
    files.change("combine:\n", mixed, file="recipe.yaml")
    (fault,) = files.faults()
    assert "'real' (px4) would ignore it: in mode OFFBOARD" in fault
    assert "fly in POSCTL" in fault
    files.change("sensor: lidar}", "sensor: lidar, to: [twin]}")
    (fault,) = files.faults()
    assert "in mode wil nobody is told" in fault
    assert "write to: [real, twin]" in fault
    files.change("    autopilot: ardupilot\n", "    autopilot: ardupilot\n    coupling: free\n")
    given = setup(files).observers["inject"]
    assert isinstance(given, InjectionSetups)
    (injection,) = given.injections
    assert (injection.thing, injection.to, injection.sensor) == (
        "obstacle_distance",
        ("twin",),
        "lidar",
    )
    assert needs(files) == []  # it goes by the vehicles' own links


def test_a_flight_back_has_what_the_vehicle_flies_by_and_nothing_virtual() -> None:
    """Without it neither a vehicle without GPS nor one with a proximity sensor is ready to arm."""

    def of(thing: Any, **more: Any) -> InjectionSetup:
        return InjectionSetup(thing=thing, to=("real",), **more)

    vision = of("vision_position_estimate", rate_hz=30.0)
    virtual = (
        of("adsb_vehicle", objects=("intruder",)),
        of("landing_target", objects=("pad",)),
        of("distance_sensor", sensor="below"),
        of("odometry", sensor="mixed"),
    )
    obstacles = of("obstacle_distance", sensor="lidar")
    back = InjectionSetups((*virtual, obstacles, vision)).on_the_way_back()
    assert back is not None
    silent = of("obstacle_distance", sensor="lidar", only_stands_by=True)
    assert back.injections == (silent, vision)
    assert (silent.only_stands_by, vision.only_stands_by) == (True, False)
    assert InjectionSetups(virtual).on_the_way_back() is None


@pytest.mark.parametrize(
    ("inject", "said"),
    [
        ("{obstacle_distance: {sensor: lidar, to: [twin]}}", "'twin' has no lidar 'lidar'"),
        ("{adsb_vehicle: {objects: [gat]}}", "no object 'gat' in the world"),
        ("{odometry: {}}", "'twin' has no motion capture"),
        ("{landing_target: {object: gate, to: [real]}}", "in mode LAND: no landing is guided"),
        ("{vision_position_estimate: {}, odometry: {}}", "delivers the pose already"),
        ("{collision: {}}", "unknown key 'collision'"),
        ("{obstacle_distance: {sensor: lidar, to: [real, real]}}", "names a vehicle twice"),
    ],
)
def test_impossible_injections_are_refused(files: Files, inject: str, said: str) -> None:
    files.append(f"inject: {inject}\n")
    assert any(said in fault for fault in files.faults())
