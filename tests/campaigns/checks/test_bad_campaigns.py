"""Every fault of a campaign's files: what is said of it, and where."""

from pathlib import Path
from typing import Any

import pytest

ONE_PLACE = [
    # what stands there, what is put there instead ("@" marks the place of the fault), what is said
    ("vehicles:", "@vehicels:", "unknown key 'vehicels'; did you mean 'vehicles'?"),
    ("campaign: small", "campaign: @a/b", "'a/b' becomes a folder"),
    ("campaign: small", "campaign: @..", "'..' becomes a folder"),
    ("campaign: small", "campaign: @5", "must be text, is 5"),
    ("schema: wil/campaign/1", "schema: @wil/campaign/2", "must be wil/campaign/1, is 'wil/c"),
    ("autopilot: px4", "autopilot: @px5", "must be px4 or ardupilot, is 'px5'; did you mean 'px4'"),
    ("profile: cage", "profile: @caeg", "no profile 'caeg'"),
    ("pose_source: mocap", "pose_source: @vicon", "must be simulator, mocap or mavlink, is"),
    (
        "pose_source: mocap",
        "pose_source: mocap\n    coupling: @free",
        "is a key of the twin; move it there",
    ),
    (
        "autopilot: ardupilot",
        "autopilot: ardupilot\n    coupling: @fallow",
        "must be follow, free, shadow or placed, is 'fallow'; did you mean 'follow'?",
    ),
    (
        "autopilot: ardupilot\n    sensors:\n",
        "autopilot: ardupilot\n    coupling: placed\n    sensors:\n      imu: @{type: imu}\n",
        "a placed twin does not fly: it has no imu; write coupling: follow",
    ),
    (
        "  large: {}",
        "  large: {vehicles.twin.coupling: placed,faults.twin: {@pose_source: {stop: {on: land}}}}",
        "a placed twin does not fly: its pose is the real vehicle's",
    ),
    (
        "start: {north_m: 0, east_m: 0}",
        "start: {@north_ft: 0, east_m: 0}",
        "unknown key 'north_ft'; did you mean 'north_m'?",
    ),
    (
        "start: {north_m: 0, east_m: 0}",
        "start: {north_m: @'0', east_m: 0}",
        "must be a number, is the text '0' (leave out the quotes)",
    ),
    (
        "start: {north_m: 0, east_m: 0}",
        "@start: {north_m: 9, east_m: 0}",
        "'real' starts 5.00 m outside of the geofence's north side",
    ),
    ("seed: 7", "seed: @-1", "must be at least 0, is -1"),
    ("seed: 7", "seed: @1.5", "must be a whole number, is 1.5"),
    ("repetitions: 3", "repetitions: @0", "must be at least 1, is 0"),
    ("seed: 7", "seed: 7\nrecord: {video: @often}", "must be failed, always or never, is 'often'"),
    (
        "seed: 7",
        "seed: 7\nrecord: {pictures: none, video: @always}",
        "is made of the recorded images, but pictures: none records no images; record them (jpeg)",
    ),
    (
        "repetitions: 3",
        "repetitions: @yes",
        "must be a whole number or a mapping, is the",
    ),
    (
        "repetitions: 3",
        "repetitions: {until: decided, at_least: 0.9, against: 0.8, most: 60, @eror: 0.1}",
        "unknown key 'eror'",
    ),
    (
        "repetitions: 3",
        "repetitions: {until: decided, at_least: 0.8, against: @0.9, most: 60}",
        "must be below at_least, 0.8",
    ),
    (
        "repetitions: 3",
        "repetitions: {until: decided, at_least: 0.95, against: 0.8, most: @17}",
        "is too few to decide: 18 flights are needed when all of them pass",
    ),
    ("{sim: 3/3", "{sim: @decided", "'decided' and `repetitions: {until: decided, ...}` need"),
    ("modes: [sim, wil]", "modes: @[]", "must have at least 1 entries, has 0"),
    ("modes: [sim, wil]", "modes: [sim, @sim]", "mode 'sim' is named twice"),
    ("modes: [sim, wil]", "modes: [sim, wil, @weal]", "must be sim, wil or real, is 'weal'"),
    ("gates: [gate]", "gates: [@gaet]", "no object 'gaet' in the world; did you mean 'gate'?"),
    ("gates: [gate]", "gates: [@cage]", "'cage' is a room, which has no opening to fly through"),
    ("gates: [gate]", "gates: [gate, @gate]", "gate 'gate' is named twice"),
    ("altitude_m: 1.2", "altitude_m: @2.4", "is 0.10 m outside of the geofence's ceiling"),
    ("altitude_m: 1.2", "altitude_m: @-1", "must be greater than 0, is -1"),
    ("altitude_m: 1.2", "@altitude_ft: 4", "unknown key 'altitude_ft'; did you mean 'altitude_m'"),
    ("up_m: [-0.5, 2.3]", "up_m: @[2.3, -0.5]", "must be [low, high], is [2.3, -0.5]"),
    ("up_m: [-0.5, 2.3]", "up_m: @[2.3]", "has too few entries (1)"),
    ("seed: 7", "limits: {@speed: 1}\nseed: 7", "unknown key 'speed'; did you mean 'speed_m_s'?"),
    ("seed: 7", "limits: {speed_m_s: @0}\nseed: 7", "must be greater than 0, is 0"),
    (
        "  large: {}",
        "  large: {limits: {up_m: [0, 1.4]}, goal.altitude_m: @1.2}",
        "is not within limits.up_m [0, 1.4] by keep_m 0.3",
    ),
    ("seed: 7", "limits: {up_m: @[2, 1]}\nseed: 7", "must be [low, high], is [2, 1]"),
    ("seed: 7", "limits: {speed_m_s: 1, keep_m: @2}\nseed: 7", "has no effect without up_m or in"),
    ("seed: 7", "limits: {up_m: @[0, 0.5]}\nseed: 7", "leaves no room: keep_m, 0.3 m, counts from"),
    ("seed: 7", "operator: {gcs: {real: @14550}}\nseed: 7", "must be text, is 14550"),
    ("seed: 7", "operator: {gcs: {real: @'memory://'}}\nseed: 7", "memory:// connects to nothing"),
    ("seed: 7", "operator: {gcs: {real: @udp:14550}}\nseed: 7", "must be a link such as udpout://"),
    (
        "seed: 7",
        "operator: {gcs: {@rael: 'x'}}\nseed: 7",
        "unknown key 'rael'; did you mean 'real'?",
    ),
    (
        "use: pilot.py:Pilot",
        "use: @plot.py:Pilot",
        "there is no file 'plot.py' beside the campaign",
    ),
    (
        "use: pilot.py:Pilot",
        "use: @pilot.py:Pliot",
        "there is no 'Pliot' in pilot.py; did you",
    ),
    (
        "use: pilot.py:Pilot",
        "use: @pilot.py:Deaf",
        "'pilot.py:Deaf' is not an autonomy: it has no met",
    ),
    ("use: pilot.py:Pilot", "use: @pilot.py:Wrong", "'pilot.py:Wrong' cannot be called with"),
    ("use: pilot.py:Pilot", "use: @pilot.py", "'pilot.py' is not of the form file.py:Name"),
    (
        "use: pilot.py:Pilot",
        "use: @gaet",
        "there is no autonomy 'gaet' (there are avoid, detour, follow, gate, place, straight",
    ),
    (
        "with: {speed_m_s: 0.8}",
        "with: @{sped_m_s: 0.8}",
        "refused by 'pilot.py:Pilot': unkno",
    ),
    ("use: pilot.py:Pilot, with: {speed_m_s: 0.8}", "use: pilot.py:Pilot, with: @5", "must be a m"),
    ("world: world.yaml", "world: @word.yaml", "there is no file 'word.yaml' beside the campaign;"),
    ("world: world.yaml", "world: @5", "must be text, is 5"),
    ("recipe: recipe.yaml", "recipe: @recipe.yml", "there is no file 'recipe.yml' beside the camp"),
    ("collision: {}", "@colision: {}", "unknown oracle 'colision'; did you mean 'collision'?"),
    ("collision: {}", "hit: {use: @colision}", "unknown oracle 'colision'; did you mean 'colli"),
    ("collision: {}", "@clearance: {}", "missing key 'min_m'"),
    ("collision: {}", "clearance: {min_m: @-1}", "must be greater than 0, is -1"),
    ("collision: {}", "clearance: {@min_cm: 1}", "unknown key 'min_cm'; did you mean 'min_m'?"),
    ("collision: {}", "collision: {exclude: [@gaet]}", "no object 'gaet' in the world; did you me"),
    ("collision: {}", "@reached_position: {tolerance_m: 1}", "oracle 'reached_position': the goal"),
    ("collision: {}", "collision: {vehicle: @twn}", "must be real or twin, is 'twn'; did you mean"),
    ("collision: {}", "collision: @5", "must be a mapping, is 5"),
    ("accept: {large: {sim: 3/3, wil: 2/3}}", "accept: @{}", "requires no run, so the campaign"),
    ("{large: {sim: 3/3, wil: 2/3}}", "{large: @{}}", "requires no run, so the campaign"),
    (
        "large: {sim: 3/3",
        "@lagre: {sim: 3/3",
        "accept names an unknown case 'lagre'; did you mean 'large'",
    ),
    (
        "accept: {",
        "published: {passed: {@lagre: {sim: 3/3}}}\naccept: {",
        "published names an unknown case 'lagre'; did you mean 'large'",
    ),
    ("accept: {", "published: {passed: {large: {sm: @3/3}}}\naccept: {", "must be sim, wil or re"),
    ("{sim: 3/3", "{@real: 3/3", "mode 'real' is not flown (modes: sim, wil)"),
    ("{sim: 3/3", "{sim: @3/4", "3/4 is of 4 runs, but there are 3 repetitions"),
    ("{sim: 3/3", "{sim: @4/3", "must ask for at least 1 pass and at most all, is '4/3'"),
    ("{sim: 3/3", "{sim: @all", "must be passes/runs like 4/5, is 'all'"),
    ("{sim: 3/3", "{sim: @3", "must be text, is 3"),
    ("  large: {}", "  @la rge: {}", "'la rge' becomes a folder"),
    (
        "small: {world.objects.gate.shape.gate.inner_size_m: 0.5}",
        "small: {@world.objects.gaet.shape.gate.inner_size_m: 0.5}",
        "override 'objects.gaet.shape.gate.inner_size_m': there is no 'gaet'; did you mean 'gate'",
    ),
    (
        "small: {world.objects.gate.shape.gate.inner_size_m: 0.5}",
        "small: {@world.objects.gate.shape.gate.inner_size: 0.5}",
        "unknown key 'inner_size'; did you mean 'inner_size_m'?",
    ),
    (
        "small: {world.objects.gate.shape.gate.inner_size_m: 0.5}",
        "small: {world.objects.gate.shape.gate.inner_size_m: @-2}",
        "must be at least 0.0001, is -2",
    ),
    (
        "small: {world.objects.gate.shape.gate.inner_size_m: 0.5}",
        "small: {@seed: 5}",
        "'seed' is the same for all cases",
    ),
    (
        "small: {world.objects.gate.shape.gate.inner_size_m: 0.5}",
        "small: {@sync.max_takeof_skew_s: 5}",
        "unknown key 'max_takeof_skew_s'; did you mean 'max_takeoff_skew_s'?",
    ),
]


def place_of(path: Path, marked: str, plain: str) -> str:
    """Return line:column of the mark, in a file that has the text without it."""
    before = path.read_text().partition(plain)[0] + marked.partition("@")[0]
    return f"{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"


@pytest.mark.parametrize(("old", "marked", "said"), ONE_PLACE)
def test_one_fault_is_reported_once_and_at_its_place(
    files: Any, old: str, marked: str, said: str
) -> None:
    plain = marked.replace("@", "")
    files.change(old, plain)
    found = files.faults()
    assert len(found) == 1, found
    assert found[0].startswith(f"campaign.yaml:{place_of(files.path, marked, plain)}: {said}")


@pytest.mark.parametrize(
    ("file", "old", "marked", "said"),
    [
        ("world.yaml", "origin:", "@orign:", "unknown key 'orign'; did you mean 'origin'?"),
        ("world.yaml", "room:", "@rom:", "unknown key 'rom'; did you mean 'room'?"),
        ("world.yaml", "bar_m: 0.1", "bar_m: @thin", "must be a number, is the text 'thin'"),
        ("recipe.yaml", "[gate]", "[@gaet]", "no object 'gaet' in the world; did you mean 'gate'"),
        ("recipe.yaml", "isolate_objects", "@isolate_object", "unknown step 'isolate_object'; did"),
        ("recipe.yaml", "sensor: camera", "sensor: @camra", "no sensor 'camra' is declared"),
    ],
)
def test_faults_of_the_other_files_are_reported_in_them(
    files: Any, file: str, old: str, marked: str, said: str
) -> None:
    plain = marked.replace("@", "")
    files.change(old, plain, file)
    found = files.faults()
    assert len(found) == 1, found
    place = place_of(files.folder / file, marked, plain)
    assert found[0].startswith(f"{file}:{place}: {said}")


def test_impossible_geometry_of_the_world_is_reported_in_it(files: Any) -> None:
    files.change("up_m: 1.2", "up_m: 0.2", "world.yaml")
    found = files.faults()
    assert found  # one for each case, as its size says how deep it stands in the floor
    assert all(fault.startswith("world.yaml:") and "floor" in fault for fault in found)


def test_all_faults_of_all_files_come_at_once(files: Any) -> None:
    files.change("autopilot: px4", "autopilot: px5")
    files.change("collision: {}", "colision: {}")
    files.change("north_m: [-1, 4]", "north_m: [4, -1]")
    files.change("room:", "rom:", "world.yaml")
    files.change("isolate_objects", "isolate_object", "recipe.yaml")
    assert [fault.split(":")[0] for fault in files.faults()] == [
        "campaign.yaml",
        "campaign.yaml",
        "campaign.yaml",
        "world.yaml",
        "recipe.yaml",
    ]


def test_keys_that_nothing_acts_on_are_unknown(files: Any) -> None:
    for key in ("abort", "resume"):
        files.path.write_text(files.path.read_text() + f"{key}: {{}}\n")
    found = files.faults()
    assert len(found) == 2
    assert all("unknown key" in fault for fault in found)


def test_a_link_string_of_another_tool_is_put_right(files: Any) -> None:
    files.path.write_text(files.path.read_text().replace("embedded", "udp:0.0.0.0:14540", 1))
    assert "udpin://0.0.0.0:14540" in files.faults()[0]


def test_a_vehicle_that_a_mode_needs_must_be_there(files: Any) -> None:
    text = files.path.read_text()
    start, end = text.index("  twin:"), text.index("world:")
    files.path.write_text(text[:start] + text[end:])
    found = files.faults()
    assert found == [
        "campaign.yaml:3:1: mode sim needs a vehicle 'twin'",
        "campaign.yaml:3:1: mode wil needs a vehicle 'twin'",
    ]


def test_mode_wil_needs_the_real_vehicle(files: Any) -> None:
    """A warning about its unmixed sensors was an internal error."""
    text = files.path.read_text()
    start, end = text.index("  real:"), text.index("  twin:")
    files.path.write_text(text[:start] + text[end:])
    assert files.faults() == ["campaign.yaml:3:1: mode wil needs a vehicle 'real'"]


@pytest.mark.parametrize("named", [".", "/dev/null"])
@pytest.mark.parametrize("key", ["world", "recipe"])
def test_a_folder_in_place_of_a_file_is_reported_at_its_key(
    files: Any, key: str, named: str
) -> None:
    """Its message named the folder alone, no campaign, line or key."""
    files.change(f"{key}: {key}.yaml", f"{key}: {named}")
    place = place_of(files.path, f"{key}: @{named}", f"{key}: {named}")
    assert files.faults() == [f"campaign.yaml:{place}: '{named}' beside the campaign is no file"]


def test_mode_wil_needs_a_recipe(files: Any) -> None:
    files.change("recipe: recipe.yaml\n", "")
    assert files.faults() == ["campaign.yaml:1:1: mode wil needs a recipe"]
    files.change("modes: [sim, wil]", "modes: [sim]")
    files.change(", wil: 2/3", "")
    assert len(files.load().runs) == 6


def test_a_sensor_of_another_type_is_named_with_its_own(files: Any) -> None:
    """Its own name was suggested: "has no lidar 'camera'; did you mean 'camera'?"."""
    files.change("{camera: {type: camera", "{camera: {type: depth", file="recipe.yaml")
    assert files.faults() == [
        f"recipe.yaml:2:11: vehicle '{vehicle}' has no depth 'camera': "
        "its 'camera' is of type camera"
        for vehicle in ("real", "twin")
    ]


def test_a_sensor_of_the_recipe_must_be_on_both_vehicles(files: Any) -> None:
    text = files.path.read_text()
    files.path.write_text(text.replace("      camera: {", "      front: {", 1))
    assert files.faults() == ["recipe.yaml:2:11: vehicle 'real' has no camera 'camera'"]


def test_a_gate_must_stand_in_the_world_that_is_judged(files: Any) -> None:
    files.append("    exists_in: {sim: none}\n", "world.yaml")
    assert files.faults() == [
        "campaign.yaml:20:33: 'gate' is not in Wv in mode sim (see its exists_in, world.yaml:11)"
    ]


def test_a_gate_outside_of_the_fence_is_reported(files: Any) -> None:
    files.change("pose: {north_m: 3.0,", "pose: {north_m: 4.1,", "world.yaml")
    assert files.faults() == [
        "campaign.yaml:20:33: 'gate' is 0.10 m outside of the geofence's north side"
    ]


def test_a_start_outside_of_the_room_is_reported(files: Any) -> None:
    files.change("pose: {north_m: 1.5}", "pose: {north_m: 3.5}", "world.yaml")
    found = files.faults()
    assert "campaign.yaml:8:5: 'real' starts outside room 'cage'" in found
    assert any("'twin' starts outside room 'cage'" in fault for fault in found)


def test_a_start_inside_of_a_thing_is_reported(files: Any) -> None:
    box = "  crate:\n    shape: {box: {size_m: [1, 1, 0.5]}}\n    pose: {up_m: 0.25}\n"
    files.append(box + "    exists_in: {sim: none, wil: W}\n", "world.yaml")
    assert files.faults() == ["campaign.yaml:8:5: 'real' starts inside 'crate'"]


def test_a_start_on_top_of_a_thing_is_good(files: Any) -> None:
    box = "  crate:\n    shape: {box: {size_m: [1, 1, 0.5]}}\n    pose: {up_m: 0.25}\n"
    files.append(box + "    exists_in: {sim: none, wil: W}\n", "world.yaml")
    files.change("start: {north_m: 0, east_m: 0}", "start: {north_m: 0, east_m: 0, up_m: 0.5}")
    assert files.load().runs


def test_a_goal_above_the_ceiling_of_the_room_is_reported(files: Any) -> None:
    files.change("height_m: 2.5", "height_m: 1.1", "world.yaml")
    assert any(
        "is not below the ceiling of room 'cage', 1.1 m up" in fault for fault in files.faults()
    )


def test_an_oracle_of_a_fence_needs_one(files: Any) -> None:
    text = files.path.read_text()
    start, end = text.index("geofence:\n  box"), text.index("oracles:")
    files.path.write_text(text[:start] + text[end:])
    assert files.faults() == [
        "campaign.yaml:31:3: oracle 'geofence': the campaign has no geofence for 'twin'",
        "campaign.yaml:31:3: oracle 'geofence': the campaign has no geofence for 'real'",
    ]


def test_an_empty_matrix_is_reported(files: Any) -> None:
    text = files.path.read_text()
    start, end = text.index("  large: {}"), text.index("modes:")
    files.path.write_text((text[:start] + text[end:]).replace("cases:\n", "cases: {}\n"))
    assert "campaign.yaml:21:8: must have at least 1 entries, has 0" in files.faults()


def test_code_of_the_user_that_fails_is_reported_with_its_line(files: Any) -> None:
    files.append("\nraise RuntimeError('no GPU')\n", "pilot.py")
    (fault,) = files.faults()
    line = len((files.folder / "pilot.py").read_text().splitlines())
    assert f"'pilot.py' cannot be loaded: line {line}: RuntimeError: no GPU" in fault


def test_code_of_the_user_that_exits_or_is_none_is_reported(files: Any) -> None:
    files.append("\nimport sys; sys.exit(0)\n", "pilot.py")
    assert "SystemExit" in files.faults()[0]
    (files.folder / "pilot.py").write_text("def :")
    assert "SyntaxError" in files.faults()[0]


def test_a_constructor_that_raises_is_reported(files: Any) -> None:
    files.change("pilot.py:Pilot", "pilot.py:Broken")
    (fault,) = files.faults()
    assert "'pilot.py:Broken' cannot be built: KeyError: 'speed'" in fault


def test_a_constructor_that_exits_is_reported(files: Any) -> None:
    files.append(
        "\nclass Gone(Pilot):\n    def __init__(self, **_):\n        raise SystemExit(0)\n",
        "pilot.py",
    )
    files.change("pilot.py:Pilot", "pilot.py:Gone")
    (fault,) = files.faults()
    assert "'pilot.py:Gone' cannot be built: SystemExit: 0" in fault


def test_prints_of_user_code_go_to_stderr(files: Any, capsys: pytest.CaptureFixture[str]) -> None:
    files.append(
        "\nprint('hello')\n\nclass Loud(Pilot):\n    def __init__(self, **_):\n"
        "        print('here I am')\n",
        "pilot.py",
    )
    files.change("pilot.py:Pilot", "pilot.py:Loud")
    files.load()
    said = capsys.readouterr()
    assert said.out == ""
    assert "hello" in said.err
    assert "here I am" in said.err


def test_nothing_is_written_beside_the_files(files: Any) -> None:
    before = sorted(files.folder.rglob("*"))
    files.load()
    assert sorted(files.folder.rglob("*")) == before


def test_a_fault_in_every_case_is_reported_once(files: Any) -> None:
    files.change("modes: [sim, wil]", "modes: [wil]")
    files.change("sim: 3/3, ", "")
    files.change("altitude_m: 1.2", "altitude_m: 2.4")
    assert len(files.faults()) == 1
