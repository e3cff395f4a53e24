"""Numbers of another unit, or of another drone, are warned of, with what they would mean."""

from typing import Any

import pytest

PROFILE = "schema: wil/profile/1\ndescription: mine\nbase: cage\n"
OWN = "airframe: {mass_kg: 1.8, arm_m: 0.25, max_thrust_n: 9, inertia_zz_kg_m2: 0.04, "
ROOMY = "    profile: mine.yaml\n    body: {width_m: 0.6, height_m: 0.2}\n"
CUBE = "".join(
    f"v {x} {y} {z}\n" for x in (0, 1000) for y in (0, 1000) for z in (0, 1000)
) + "".join(
    f"f {a} {b} {c} {d}\n"
    for a, b, c, d in (
        *((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2)),
        *((3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)),
    )
)


def warned(files: Any) -> list[str]:
    return [warning.headline.removeprefix(f"{files.folder}/") for warning in files.load().warnings]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (OWN + "inertia_xx_kg_m2: 0.0225, inertia_yy_kg_m2: 0.0225}", ""),
        (
            OWN + "inertia_xx_kg_m2: 0.0045, inertia_yy_kg_m2: 0.0225}",
            (
                "airframe.inertia_xx_kg_m2 of 0.0045 is 0.04 x mass x arm², published quadrotors "
                "have 0.15 to 0.31: usually about 0.023 kg m² for 1.8 kg on arms of 0.25 m"
            ),
        ),
        ("airframe: {mass_kg: 1.8, arm_m: 0.25, max_thrust_n: 9}", ""),
        (
            "airframe: {mass_kg: 1, max_thrust_n: 5, inertia_yy_kg_m2: 0.00232}",
            (
                "airframe.inertia_yy_kg_m2 of 0.00232 is 0.076 x mass x arm², published "
                "quadrotors have 0.15 to 0.31: usually about 0.0061 kg m² for 1 kg on arms of "
                "0.175 m"
            ),
        ),
        ("battery: {full_v: 16.8, empty_v: 14}", ""),
        (
            "battery: {full_v: 12600, empty_v: 10500}",
            "battery.full_v of 12600 V: one cell has 4.2 V, large drones 60 V",
        ),
        (
            "battery: {capacity_mah: 2.7}",
            (
                "battery.capacity_mah of 2.7 mAh lasts for 0.025 min at battery.hover_current_a "
                "of 6.5 A"
            ),
        ),
        ("camera: {latency_s: 60}", "camera.latency_s of 60 s: milliseconds would be 0.06"),
    ],
)
def test_a_profile_of_another_drone_or_unit_is_warned_of(files: Any, lines: str, said: str) -> None:
    (files.folder / "mine.yaml").write_text(f"{PROFILE}{lines}\n")
    files.change("    profile: cage\n", ROOMY)
    files.change("inner_size_m: 0.5", "inner_size_m: 0.7")
    assert [one.partition(": ")[2] for one in warned(files)] == ([said] if said else [])


def test_a_body_narrower_than_its_motors_is_warned_of(files: Any) -> None:
    lines = OWN + "inertia_xx_kg_m2: 0.0225, inertia_yy_kg_m2: 0.0225}"
    (files.folder / "mine.yaml").write_text(f"{PROFILE}{lines}\n")
    files.change("    profile: cage\n", ROOMY.replace("0.6", "0.06"))
    (told,) = warned(files)
    assert told.endswith(": a body 0.06 m wide, but its motors alone span 0.35 m")


def test_a_battery_that_is_full_when_empty_is_a_fault(files: Any) -> None:
    (files.folder / "mine.yaml").write_text(f"{PROFILE}battery: {{full_v: 10, empty_v: 12}}\n")
    files.change("    profile: cage\n", ROOMY)
    (fault,) = files.faults()
    assert "mine.yaml:4:" in fault
    assert fault.endswith("12 V is not below full_v, 10 V")


def test_a_field_of_view_in_radians_is_warned_of(files: Any) -> None:
    text = (files.folder / "campaign.yaml").read_text()
    (files.folder / "campaign.yaml").write_text(text.replace("fov_deg: 69", "fov_deg: 1.2"))
    said = "a field of view of 1.2 degrees is a telescope's: in radians it would be 69 degrees"
    assert [one.partition(": ")[2] for one in warned(files)] == [said, said]


@pytest.mark.parametrize(
    ("scale", "said"),
    [
        ("", "is 1e+03 x 1e+03 x 1e+03 m large: if its file is in millimetres, set scale: 0.001"),
        (", scale: 0.001", ""),
        (
            ", scale: 0.000001",
            "is 0.001 x 0.001 x 0.001 m small: if its file is in metres, leave `scale` out",
        ),
    ],
)
def test_a_mesh_in_another_unit_is_warned_of(files: Any, scale: str, said: str) -> None:
    (files.folder / "cube.obj").write_text(CUBE)
    files.append(
        f"  cube:\n    shape: {{mesh: {{file: cube.obj{scale}}}}}\n"
        "    pose: {north_m: 20, up_m: 1}\n    exists_in: {sim: Wv, wil: both, real: W}\n",
        file="world.yaml",
    )
    told = [one.partition(": ")[2] for one in warned(files)]
    assert [one for one in told if one.startswith("is ")] == ([said] if said else [])


@pytest.mark.parametrize(("east", "said"), [("900", False), ("3000", True)])
def test_a_mesh_far_from_its_own_origin_is_warned_of(files: Any, east: str, said: bool) -> None:
    """One in coordinates of a map stood kilometres away: nothing was seen or touched."""
    cube = CUBE.replace("1000", "1").replace("v 0", f"v {east}").replace("v 1", f"v {east}.5")
    (files.folder / "cube.obj").write_text(cube)
    files.append("  cube:\n    shape: {mesh: {file: cube.obj}}\n", "world.yaml")
    text = "begins 3e+03 m from the origin of its file, which is what `pose` places"
    assert any(text in one for one in warned(files)) is said


@pytest.mark.parametrize(("half", "is_wide"), [(500, False), (2000, True)])
def test_an_opening_far_wider_than_its_mesh_is_warned_of(
    files: Any, half: int, is_wide: bool
) -> None:
    """A flight past the frame would be one through it."""
    (files.folder / "cube.obj").write_text(CUBE)
    corners = f"[[0, -{half}, -{half}], [0, {half}, -{half}], [0, {half}, {half}]]"
    files.append(
        f"  cube:\n    shape: {{mesh: {{file: cube.obj, opening: {{polygon_m: {corners}}}}}}}\n"
        "    pose: {north_m: 20, up_m: 1}\n    exists_in: {sim: Wv, wil: both, real: W}\n",
        file="world.yaml",
    )
    said = "is 4e+03 m across, and its mesh 1e+03 m: what flies past it is through"
    told = [one for one in warned(files) if "past it" in one]
    assert len(told) == is_wide
    assert all(said in one for one in told)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("yaw_rad: 6.28", []),
        ("yaw_rad: -90", ["-90 radians are -14.3 turns: as degrees it is -1.571 rad"]),
        (
            "course: {yaws_rad: [0, 180]}",
            ["180 radians are 28.6 turns: as degrees it is 3.142 rad"],
        ),
        ("turn_rad_s: 7", []),
    ],
)
def test_degrees_in_a_key_of_radians_are_warned_of(files: Any, given: str, said: list[str]) -> None:
    files.change('if set(parameters) - {"speed_m_s"}', "if not {*parameters}", file="pilot.py")
    files.change("with: {speed_m_s: 0.8}", f"with: {{speed_m_s: 0.8, {given}}}")
    told = [one.partition(": ")[2] for one in warned(files)]
    assert [one for one in told if "radians" in one] == said


def test_a_world_in_millimetres_is_pointed_at_in_its_own_file(files: Any) -> None:
    metres = "{inner_size_m: 1.0, bar_m: 0.1}}\n    pose: {north_m: 3.0, up_m: 1.2}"
    files.change(metres, metres.replace("3.0", "3000"), file="world.yaml")
    (fault,) = files.faults()
    assert "world.yaml:9:5: 'gate' is 2996.00 m outside of the geofence's north side" in fault
    assert "lengths are in metres" in fault
    files.change("north_m: 3000", "north_m: 3.0", file="world.yaml")
    room = "{size_north_m: 6, size_east_m: 6, height_m: 2.5}"
    vast = "{size_north_m: 6000, size_east_m: 6000, height_m: 2500}"
    files.change(room, vast, file="world.yaml")
    (told,) = [one for one in warned(files) if "large" in one]
    assert told == "world.yaml:5:13: is 6e+03 x 6e+03 x 2.5e+03 m large: lengths are in metres"
