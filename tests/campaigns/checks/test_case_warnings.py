"""What `validate` warns of, and what it finds in one pass."""

import gc
import math
import multiprocessing
import os
import threading
import time
from pathlib import Path
from typing import Any

import pytest

import wil_campaign
from tests.wil_campaign.foundation.processes.busy_core import one_busy_core
from wil_campaign.campaigns.checks import autonomy_checks
from wil_campaign.orchestrator.cli import main


def warned(files: Any) -> list[str]:
    """Return the warnings of the campaign, without the folder."""
    return [warning.headline.removeprefix(f"{files.folder}/") for warning in files.load().warnings]


def test_a_good_campaign_is_not_warned_of(files: Any) -> None:
    assert warned(files) == []
    assert files.load().caveats == ()


@pytest.mark.parametrize("is_fenced", [True, False])
def test_an_attached_vehicle_without_a_fence_is_warned_of(files: Any, is_fenced: bool) -> None:
    sets = ("vehicles.real.link=udpin://127.0.0.1:14555", "vehicles.real.pose_source=mavlink")
    if not is_fenced:
        files.change("  geofence:\n", "")
    given = files.load(sets=sets if is_fenced else (*sets, "geofence=null"))
    said = [one.headline.partition(": ")[2] for one in given.warnings]
    message = "'real' is attached, may be hardware, and has no geofence: neither the guard nor its"
    assert [one for one in said if "geofence" in one] == (
        [] if is_fenced else [f"{message} autopilot stops it"]
    )


def _round_fence(files: Any, corners: int) -> None:
    """Replace the campaign's fence by a polygon of so many corners around its box."""
    turns = [2 * math.pi * each / corners for each in range(corners)]
    places = [[round(1 + 6 * math.cos(t), 6), round(6 * math.sin(t), 6)] for t in turns]
    text = files.path.read_text()
    box = text[text.index("geofence:\n  box") :].partition("\noracles:")[0]
    files.change(box, f"geofence: {{include: [{{polygon: {places}}}], up_m: [-0.5, 2.3]}}")


@pytest.mark.parametrize(
    ("corners", "refused"), [(64, []), (65, ["PX4"]), (71, ["ArduCopter", "PX4"])]
)
def test_a_fence_that_its_autopilot_does_not_store_is_refused(
    files: Any, corners: int, refused: list[str]
) -> None:
    """It passed, and the autopilot refused it before arming: each flight was an ERROR."""
    _round_fence(files, corners)
    said = [one for one in (files.faults() if refused else warned(files)) if "stores" in one]
    assert [one.split(": ")[1].split()[0] for one in said] == refused
    assert all(f"its fence has {corners} of them, 1 m wider" in one for one in said)
    files.append("preflight: {fence: null}\n")
    assert [one for one in warned(files) if "stores" in one] == []


def test_a_fence_that_firmware_may_not_store_is_warned_of(files: Any) -> None:
    _round_fence(files, 71)
    sets = ("vehicles.real.link=udpin://127.0.0.1:14555", "vehicles.real.pose_source=mavlink")
    given = files.load(sets=(*sets, "modes=[real]", "accept=null"))
    (said,) = [one.headline for one in given.warnings if "stores" in one.headline]
    assert "PX4 of 'real' stores 64 corners and circles, and its fence has 71 of them" in said


def test_what_is_of_a_vehicle_that_no_mode_flies_is_warned_of(files: Any) -> None:
    files.change("  geofence:\n", "  geofence:\n  low: {use: altitude, max_m: 2, vehicle: real}\n")
    files.change("  geofence:\n", "  geofence:\n  twin_divergence: {max_m: 1}\n")
    files.append("faults: {real: {pose_source: {stop: {on: goal}}}}\n")
    files.append("links: {real: {loss: 0.1}, twin: {loss: 0.1}}\n")
    assert warned(files) == []
    files.change("modes: [sim, wil]", "modes: [sim]")
    files.change("{sim: 3/3, wil: 2/3}", "{sim: 3/3}")
    assert [one.partition(": ")[2] for one in warned(files)] == [
        "'twin_divergence' judges a pair, and mode wil is not flown: it judges nothing",
        "'low' judges 'real', which no mode flies: it judges nothing",
        "no mode flies 'real': faults.real has no effect",
        "no mode flies 'real': links.real has no effect",
    ]
    assert len(files.load().caveats) == 5


def test_an_action_on_the_loss_of_operators_that_there_are_not_is_warned_of(files: Any) -> None:
    files.append("operator: {on_operator_loss: abort}\n")
    (told,) = warned(files)
    assert told.endswith("never acts: no channel of operators (mqtt)")
    given = files.load(sets=("operator.mqtt={broker: mqtt://localhost}",))
    assert given.warnings == ()


def test_a_link_to_a_placed_twin_is_warned_of(files: Any) -> None:
    files.change("autopilot: ardupilot\n", "autopilot: ardupilot\n    coupling: placed\n")
    files.append("links: {twin: {loss: 0.1}}\n")
    assert warned(files) == []
    files.change("modes: [sim, wil]", "modes: [wil]")
    files.change("{sim: 3/3, wil: 2/3}", "{wil: 2/3}")
    (told,) = warned(files)
    assert told.endswith("no mode flies 'twin': links.twin has no effect")


@pytest.mark.parametrize(
    ("changes", "expect", "said"),
    [
        ("oracles.time_limit.limit_s: 1", "oracle: time_limit", "changes 'time_limit', which"),
        (
            "oracles: {reached: {}, time_limit: {limit_s: 1}}",
            "oracle: time_limit",
            "changes 'time_limit', which",
        ),
        ("geofence.box.up_m: [-0.5, 2.2]", "oracle: geofence", "changes 'geofence', which"),
        ("oracles.time_limit.limit_s: 1", "oracle: reached", None),
        ("autonomy.with.speed_m_s: 1", "oracle: time_limit", None),
        ("autonomy.with.speed_m_s: 1", "cause: the", "'the' is in the reason of nearly any run"),
        (
            "autonomy.with.speed_m_s: 1",
            "cause: of real",
            "'of real' is in the reason of nearly any",
        ),
        ("autonomy.with.speed_m_s: 1", "cause: pose of real", None),
    ],
)
def test_a_control_that_proves_nothing_is_warned_of(
    files: Any, changes: str, expect: str, said: str | None
) -> None:
    files.append(f"controls:\n  odd:\n    set: {{{changes}}}\n    expect: {{{expect}}}\n")
    found = warned(files)
    assert len(found) == (said is not None), found
    assert all(one.startswith("campaign.yaml:") and said in one for one in found if said)


def test_an_angle_without_end_is_a_fault_of_its_own(files: Any) -> None:
    files.change("east_m: 0}", "east_m: 0, yaw_deg: 1e308}")
    assert "must be at most 360, is 1e+308" in files.faults()[0]


@pytest.mark.parametrize(("place", "most"), [("east_m: 1e6", 1e5), ("east_m: 0, up_m: 1e6", 1e4)])
def test_a_start_is_in_the_air_that_is_modelled(files: Any, place: str, most: float) -> None:
    """Of 1,000 km north, where a flat world is 78 km high, the air's pressure was no number."""
    files.change("east_m: 0}", f"{place}}}")
    assert f"must be at most {most:.0f}, is 1000000" in files.faults()[0]


def test_a_gate_that_no_required_oracle_asks_for_is_a_caveat(files: Any) -> None:
    files.change("  reached: {}\n", "  reached: {required: false}\n")
    text = "no required oracle checks that gate 'gate' of the goal is flown through"
    assert warned(files) == [f"campaign.yaml:20:33: {text}"]
    assert files.load().caveats == (text,)


def test_a_position_that_no_required_oracle_asks_for_is_a_caveat(files: Any) -> None:
    wanted = "reached_position: {tolerance_m: 0.3"
    files.change("  reached: {}\n", f"  {wanted}, required: false}}\n")
    files.change("gates: [gate]", "position: {north_m: 2, east_m: 0, up_m: 1.2}")
    text = "no required oracle checks that the goal's position is reached: `reached_position`"
    assert [one.partition(": ")[2] for one in warned(files)] == [text]
    files.change(", required: false}", "}")
    assert warned(files) == []


def test_a_mixture_that_the_judged_vehicle_does_not_perceive_is_a_caveat(files: Any) -> None:
    both = "    publish: [twin]\n"
    files.append(both, file="recipe.yaml")
    text = "nothing is published to 'real': the vehicle judged in mode wil perceives no mixture"
    assert warned(files) == [f"recipe.yaml:3:1: {text}"]
    assert files.load().caveats == (text,)
    files.change("publish: [twin]", "publish: [real]", file="recipe.yaml")
    assert warned(files) == []


@pytest.mark.parametrize(("limit_px", "is_wide"), [("16", False), ("17", True), ("5000", True)])
def test_a_limit_that_switches_registration_off_is_a_caveat(
    files: Any, limit_px: str, is_wide: bool
) -> None:
    files.append(f"    max_registration_error_px: {limit_px}\n", file="recipe.yaml")
    text = (
        f"accepts virtual objects {limit_px} px beside their place, in images of 'camera' that are "
        "320 px wide: set at most 16, or remove the key for the default"
    )
    assert warned(files) == ([f"recipe.yaml:7:32: {text}"] if is_wide else [])
    assert files.load().caveats == ((text,) if is_wide else ())


EXISTS = "    exists_in: {sim: Wv, wil: Wv, real: W}\n"
INTRUDER = f"""\
  intruder:
    shape: {{box: {{size_m: [0.3, 0.3, 0.1]}}}}
    pose: {{north_m: 3.5, east_m: 1.0, up_m: 1.0}}
{EXISTS}"""


@pytest.mark.parametrize(
    ("filters", "merge", "is_caveat"),
    [
        ("", "replace: {source: twin}", True),
        ("", "overlay: {occlusion: none}", True),
        ("", "overlay: {priority: [twin, real]}", False),
        ("", "replace: {source: twin, region: {left: 0.5}}", False),
        ("    filter: [{isolate_objects: [gate]}]\n", "replace: {source: twin}", False),
    ],
)
def test_a_mixture_in_which_nothing_is_real_is_a_caveat(
    files: Any, filters: str, merge: str, *, is_caveat: bool
) -> None:
    """A run in mode wil passed on the twin's images alone, as in simulation."""
    files.change("    filter: [{isolate_objects: [gate]}]\n", filters, file="recipe.yaml")
    files.change("overlay: {priority: [twin, real]}", merge, file="recipe.yaml")
    text = "the mixture of 'camera' is the twin's reading alone: nothing real is in it"
    assert files.load().caveats == ((text,) if is_caveat else ())


def test_a_recipe_that_isolates_only_what_the_virtual_world_lacks_is_a_caveat(files: Any) -> None:
    """The mixture is the real image then, and whatever is passed is passed without the object."""
    files.append(INTRUDER.replace("wil: Wv", "wil: none"), file="world.yaml")
    files.change("[gate]", "[intruder]", file="recipe.yaml")
    text = "isolates 'intruder' alone, and Wv in mode wil has nothing of it: nothing is mixed in"
    assert warned(files) == [f"recipe.yaml:5:5: {text}"]
    assert files.load().caveats == (text,)
    files.change("[intruder]", "[gate, intruder]", file="recipe.yaml")
    assert warned(files) == []


VIRTUAL_GATE = "    color: orange\n" + EXISTS
BLUE_GATE = VIRTUAL_GATE.replace("orange", '"#2030c0"')


@pytest.mark.parametrize(
    ("gate", "steps", "merge", "said"),
    [
        (VIRTUAL_GATE, "isolate_color: orange", "overlay: {}", ""),
        (BLUE_GATE, "isolate_color: orange", "overlay: {}", "no filter keeps its colour (#2030c0)"),
        (BLUE_GATE, "isolate_color: blue", "overlay: {}", ""),
        (BLUE_GATE, "isolate_objects: [gate]", "overlay: {}", ""),
        (VIRTUAL_GATE, "isolate_depth: {max_m: 3}", "overlay: {}", ""),
        (
            VIRTUAL_GATE,
            "isolate_objects: [gate]",
            "overlay: {priority: [real, twin]}",
            "the merge takes nothing of the twin's image",
        ),
        (
            VIRTUAL_GATE,
            "isolate_objects: [gate]",
            "replace: real",
            "the merge takes nothing of the twin's image",
        ),
        (VIRTUAL_GATE, "isolate_color: {name: black, on: real}", "overlay: [real, twin]", ""),
        (
            VIRTUAL_GATE,
            "isolate_depth: {max_m: 9}",
            "overlay: [real, twin]",
            "the merge takes nothing of the twin's image",
        ),
        (VIRTUAL_GATE, "isolate_objects: [gate]", "overlay: {soft_edge_px: 50}", ""),
        (
            VIRTUAL_GATE,
            "isolate_objects: [gate]",
            "replace: {region: {left: 0.48, top: 0.48, right: 0.52, bottom: 0.52}}",
            "",
        ),
        (VIRTUAL_GATE, "subtract_background: {}", "overlay: {}", ""),
        (VIRTUAL_GATE.replace("wil: Wv", "wil: both"), "isolate_color: blue", "overlay: {}", ""),
    ],
)
def test_an_object_that_no_mixture_can_show_is_a_caveat(
    files: Any, gate: str, steps: str, merge: str, said: str
) -> None:
    files.change("    color: orange\n", gate, file="world.yaml")
    files.change("{isolate_objects: [gate]}", f"{{{steps}}}", file="recipe.yaml")
    files.change("overlay: {priority: [twin, real]}", merge, file="recipe.yaml")
    text = f"no mixture can show 'gate': {said}, and the autonomy never perceives it"
    assert files.load().caveats == ((text,) if said else ())


@pytest.mark.parametrize(("gap_s", "said"), [("1.0", False), ("20", True)])
def test_positions_that_may_be_missing_for_long_are_a_caveat(
    files: Any, gap_s: str, said: bool
) -> None:
    files.change(
        "autopilot: ardupilot", f"autopilot: ardupilot\n    telemetry: {{max_gap_s: {gap_s}}}"
    )
    text = "positions of 'twin' may be missing for 20 s: its flight meanwhile is not judged"
    assert files.load().caveats == ((text,) if said else ())
    files.change("modes: [sim, wil]", "modes: [wil]")
    files.change("accept: {large: {sim: 3/3, wil: 2/3}}", "accept: {large: {wil: 2/3}}")
    assert files.load().caveats == (), "the twin is not judged in mode wil"


@pytest.mark.parametrize(
    ("shape", "free"),
    [
        ("gate: {inner_size_m: 0.25, bar_m: 0.1}", "0.25"),
        ("gate: {form: ring, inner_size_m: 0.25, bar_m: 0.1}", "0.25"),
        ("mesh: {file: gate.obj, opening: {polygon_m: [CORNERS]}}", "0.20"),
    ],
)
def test_a_gate_narrower_than_the_vehicle_is_warned_of(files: Any, shape: str, free: str) -> None:
    corners = ["[0, -0.1, -0.3]", "[0, 0.1, -0.3]", "[0, 0.1, 0.3]", "[0, -0.1, 0.3]"]
    (files.folder / "gate.obj").write_text(
        "v 0 1 -1\nv 0 1 1\nv 0 2 1\nv 0 2 -1\nf 1 2 3\nf 1 3 4\n"
    )
    narrow = f"{{{shape.replace('CORNERS', ', '.join(corners))}}}"
    files.change("  large:", f"  narrow: {{world.objects.gate.shape: {narrow}}}\n  large:")
    files.change(
        "    pose: {north_m: 3.0, up_m: 1.2}",
        "    pose: {north_m: 3.0, up_m: 1.2, yaw_deg: 30}",
        "world.yaml",
    )
    assert [one.partition(": ")[2] for one in warned(files)] == [
        f"case narrow: 'gate' is open {free} m across, and the body of '{name}' is 0.3 m wide: it "
        "does not fly through level"
        for name in ("twin", "real")
    ]
    assert len(files.load().caveats) == 2, "a run says so too"
    files.change("narrow: {", "narrow: {vehicles.real.body: SMALL, vehicles.twin.body: SMALL, ")
    text = files.path.read_text()
    files.path.write_text(text.replace("SMALL", "{width_m: 0.15, height_m: 0.1}"))
    assert warned(files) == []


def test_validate_takes_set_and_warns_without_failing(files: Any, capsys: Any) -> None:
    given = ["validate", str(files.path), "--set", "oracles.battery.min_percent=0"]
    assert main(given) == 0
    assert "warning: --set oracles.battery.min_percent=0" in capsys.readouterr().err
    assert main(["validate", str(files.path), "--set", "goal.altitude_m=9"]) == 2
    assert "ceiling" in capsys.readouterr().err


def test_warnings_are_reported_beside_faults(files: Any, capsys: Any) -> None:
    files.change("fov_deg: 69}\n  twin", "fov_deg: 1.2}\n  twin")
    files.change("east_m: [-2, 2]", "east_m: [-2000, 2000]")
    assert main(["validate", str(files.path)]) == 2
    said = capsys.readouterr().err
    assert "the fence is 4000 m wide, and the room 6 m" in said
    assert "give both the same field of view" in said
    files.change("world: world.yaml", "world: wrld.yaml")
    assert main(["validate", str(files.path)]) == 2
    said = capsys.readouterr().err
    assert "wrld.yaml" in said


def test_a_missing_world_hides_neither_fence_nor_formula(files: Any) -> None:
    files.change("world: world.yaml", "world: word.yaml")
    files.change("north_m: [-1, 4]", "north_m: [1, 4]")
    rule = '"always (upp_m < 2 and distance_gate_m > 0 and fence_margin_m > 0)"'
    files.change("  collision: {}", f"  collision: {{}}\n  rule: {{stl: {rule}}}")
    said = [fault.partition(": ")[2] for fault in files.faults()]
    assert said == [
        "'real' starts 1.00 m outside of the geofence's south side",
        "'twin' starts 1.00 m outside of the geofence's south side",
        "there is no file 'word.yaml' beside the campaign; did you mean 'world.yaml'?",
        "oracle 'rule': unknown signal 'upp_m'; did you mean 'up_m'?",
    ]


def test_a_fence_on_earth_waits_for_the_world(files: Any) -> None:
    files.change("world: world.yaml", "world: word.yaml")
    on_earth = "latitude_deg: [47.39, 47.41], longitude_deg: [8.49, 8.51]"
    files.change("north_m: [-1, 4], east_m: [-2, 2]", on_earth)
    (fault,) = files.faults()
    assert "there is no file 'word.yaml'" in fault


def test_all_missing_files_and_the_autonomys_are_reported_at_once(files: Any, capsys: Any) -> None:
    files.change("world: world.yaml", "world: wrld.yaml")
    files.change("recipe: recipe.yaml", "recipe: nowhere.yaml")
    files.change("use: pilot.py:Pilot", "use: pilt.py:Pilot")
    assert main(["validate", str(files.path)]) == 2
    said = capsys.readouterr().err
    for name in ("wrld.yaml", "nowhere.yaml", "pilt.py"):
        assert name in said
    assert "3 problems in 1 file" in said


@pytest.mark.parametrize(
    "fault",
    [
        (
            "import signal, time\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\ntime.sleep(600)\n",
            1.0,
            "is not imported and built within 1 s: it blocks",
        ),
        ("import os\nos._exit(7)\n", 5.0, "ends its process (exit status 7)"),
        (
            "KEPT = b'x' * 5_000_000_000\n",
            5.0,
            "it asks for more memory than autonomy.limits.memory_mb",
        ),
    ],
)
@pytest.mark.parametrize("command", ["validate", "plan", "run"])
def test_an_autonomy_that_blocks_or_dies_on_import_is_a_fault(
    files: Any,
    capsys: Any,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    fault: tuple[str, float, str],
) -> None:
    code, build_s, text = fault
    monkeypatch.setattr("wil_campaign.campaigns.checks.autonomy_checks.LONGEST_BUILD_S", build_s)
    pilot = Path(files.folder) / "pilot.py"
    pilot.write_text(code + pilot.read_text())
    began_s = time.monotonic()
    assert main([command, str(files.path)]) == 2
    assert text in capsys.readouterr().err
    assert time.monotonic() - began_s < 200.0


def test_validate_gives_up_on_an_autonomy_that_blocks_after_its_own_limit(
    files: Any, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    allowed_s: list[float] = []

    def never(connection: Any, _pid: int, limit_s: float) -> bool:
        begins = limit_s in {autonomy_checks._LONGEST_FORK_S, autonomy_checks._LONGEST_SPAWN_S}
        if not begins:
            allowed_s.append(limit_s)
            return False
        return bool(connection.poll(120.0))

    monkeypatch.setattr(autonomy_checks, "_is_answered", never)
    monkeypatch.setattr(threading, "active_count", lambda: 1)
    files.change("use: pilot.py:Pilot", "use: pilot.py:Pilot, limits: {build_s: 6}")
    assert main(["validate", str(files.path)]) == 2
    assert "is not imported and built within 6 s: it blocks" in capsys.readouterr().err
    assert allowed_s == [2.0, 4.0]


def test_a_fork_that_waits_for_a_lock_is_no_evidence_that_the_autonomy_blocks(
    files: Any, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = threading.Lock()
    parent = os.getpid()

    def wait_in_a_fork() -> None:
        if os.getpid() != parent:
            lock.acquire()

    os.register_at_fork(after_in_child=wait_in_a_fork)
    monkeypatch.setattr("wil_campaign.campaigns.checks.autonomy_checks._LONGEST_FORK_S", 0.5)
    monkeypatch.setattr(threading, "active_count", lambda: 1)
    with lock:
        assert main(["validate", str(files.path)]) == 0, capsys.readouterr().err


class _EndsItsThread:
    """What cannot be freed in a fork, as FFmpeg's scaler: it waits for a thread of its own."""

    def __init__(self) -> None:
        self.pid, self.itself = os.getpid(), self

    def __del__(self) -> None:
        while os.getpid() != self.pid:
            time.sleep(1.0)


def test_garbage_of_this_process_is_not_collected_in_a_fork(
    files: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    fork_alone = {"fork": multiprocessing.get_context("fork")}
    monkeypatch.setattr(multiprocessing, "get_context", fork_alone.__getitem__)
    monkeypatch.setattr(threading, "active_count", lambda: 1)
    monkeypatch.setattr("wil_campaign.campaigns.checks.autonomy_checks.LONGEST_BUILD_S", 6.0)
    autonomy = Path(files.folder) / "pilot.py"
    autonomy.write_text(f"import gc\ngc.collect()\n{autonomy.read_text()}")
    gc.disable()
    try:
        _EndsItsThread()
        assert wil_campaign.validate(files.path) == ()
    finally:
        gc.enable()


def test_time_without_a_processor_is_not_the_autonomys(
    files: Any, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wil_campaign.campaigns.checks.autonomy_checks.LONGEST_BUILD_S", 9.0)
    monkeypatch.setattr(threading, "active_count", lambda: 1)  # a fork has a third of it
    autonomy, runs = Path(files.folder) / "pilot.py", Path(files.folder) / "runs"
    works = f"import time\nopen({str(runs)!r}, 'a').write('x')\n"
    works += "while time.process_time() < 1.2: pass\n"
    autonomy.write_text(works + autonomy.read_text())
    began_s = time.monotonic()
    with one_busy_core(4):
        code = main(["validate", str(files.path)])
    assert (code, runs.read_text()) == (0, "x"), capsys.readouterr().err
    assert time.monotonic() - began_s > 3.0


def test_a_rate_that_the_cameras_do_not_reach_is_reported_with_what_is_asked(files: Any) -> None:
    files.change("rate_hz: 15", "rate_hz: 30", file="recipe.yaml")
    (fault,) = files.faults()
    assert "has a rate of 15 Hz, the recipe asks for 30 Hz" in fault


def test_a_fault_of_one_case_names_it_where_its_line_does_not(files: Any) -> None:
    """The class is named in `autonomy`, and what it refuses comes of the case."""
    files.change("small: {", "small: {autonomy.with.height_m: 1, ")
    (fault,) = files.faults()
    assert "case small: refused by 'pilot.py:Pilot': unknown parameters" in fault
    files.change("large: {}", "large: {autonomy.with.height_m: 1}")
    (fault,) = files.faults()
    assert ": refused by 'pilot.py:Pilot'" in fault
    assert "case" not in fault


def test_a_caveat_of_one_case_names_it(files: Any) -> None:
    files.change("    color: orange\n", VIRTUAL_GATE, file="world.yaml")
    files.change("{isolate_objects: [gate]}", "{isolate_color: orange}", file="recipe.yaml")
    files.change("small: {", "small: {world.objects.gate.color: blue, ")
    (caveat,) = files.load().caveats
    assert caveat.startswith("case small: no mixture can show 'gate'")
