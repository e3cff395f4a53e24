"""`wil-campaign init --from LOG`: the files of a campaign around a logged flight.

The battery of a logged flight, as a profile has it; pure.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from statistics import median

from wil_campaign.foundation.files.problems import BadInput, Problem, printable_problem
from wil_campaign.foundation.files.yaml_nodes import yaml_of_word
from wil_campaign.plugins.logs.course import FlightCourse, course_of_flight
from wil_campaign.plugins.logs.log_reader import read_log
from wil_campaign.plugins.logs.logged_flight import FlightLogError, LoggedFlight
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.embedded.autopilot.known_parameters import default_parameters
from wil_campaign.worlds.geodesy import Geodetic, LocalFrame

_CELLS = ("BAT1_N_CELLS", "BAT_N_CELLS", "BAT_N_CELLS_1")
_CAPACITY = ("BAT1_CAPACITY", "BAT_CAPACITY", "BATT_CAPACITY")
_FULL_V, _EMPTY_V = 4.2, 3.5
"""Of a lithium polymer cell, as of the shipped profiles."""
_LEAST_SAMPLES = 5


@dataclass(frozen=True, slots=True)
class BatteryKeys:
    """The keys of a profile's `battery` that a log tells, with their values.

    guessed: how many cells there are, by the greatest voltage alone; 0 where a parameter tells.
    """

    values: Mapping[str, float]
    guessed: int = 0


def battery_of_flight(flight: LoggedFlight, course: FlightCourse | None) -> BatteryKeys | None:
    """Return what a log tells of the battery; None where that is nothing."""
    found: dict[str, float] = {}
    cells, guessed = _first(flight, _CELLS), 0
    if not cells and flight.power:
        guessed = round(max(power_sample.voltage_v for power_sample in flight.power) / 4.1)
        cells = float(guessed)
    if cells:
        found["full_v"] = round(cells * _FULL_V, 2)
        found["empty_v"] = round(cells * _EMPTY_V, 2)
    capacity = _first(flight, _CAPACITY)
    if capacity:
        found["capacity_mah"] = round(capacity, 0)
    if course is not None:
        end_s = course.begin_s + course.duration_s
        amperes = [
            power_sample.current_a
            for power_sample in flight.power
            if power_sample.current_a is not None and course.begin_s <= power_sample.t_s <= end_s
        ]
        if len(amperes) >= _LEAST_SAMPLES and median(amperes) > 0.5:
            found["hover_current_a"] = round(median(amperes), 2)
    return BatteryKeys(found, guessed) if found else None


def _first(flight: LoggedFlight, names: tuple[str, ...]) -> float:
    """Return the first positive value of parameters; 0 for none."""
    return next((value for name in names if (value := flight.parameters.get(name, 0.0)) > 0), 0.0)


_AHEAD_M, _UP_M = 3.0, 2.0
_UNTOLD = Geodetic(47.397742, 8.545594, 488.0)
_PROFILE = "profile.yaml"


def files_from_log(log: Path, name: str, *, profile: bool) -> dict[str, str]:
    """Return the texts of a campaign's files by name, from a log. name: the campaign's.

    profile: whether one of them is the vehicle's profile. Raises BadInput.
    """
    try:
        flight = read_log(log)
        autopilot = flight.autopilot or "px4"
        autopilot_named(autopilot)
    except (FlightLogError, ValueError) as error:
        message = str(error).removeprefix(f"{log} ")
        raise BadInput([Problem(str(log), 0, 0, message)]) from error
    course = course_of_flight(flight)
    texts = {
        "campaign.yaml": _campaign(flight, course, name=name, log=log, profile=profile),
        "world.yaml": _world(flight, course),
        "autonomy.py": _autonomy(),
        f"{autopilot}.params": _parameter_file(flight),
    }
    if profile:
        texts[_PROFILE] = _profile(battery_of_flight(flight, course), log)
    return texts


def _campaign(
    flight: LoggedFlight, course: FlightCourse | None, *, name: str, log: Path, profile: bool
) -> str:
    autopilot, own = flight.autopilot or "px4", _PROFILE if profile else "nominal"
    yaw = None if course is None or course.yaw_rad is None else math.degrees(course.yaw_rad)
    lines = [
        "# yaml-language-server: $schema=schemas/campaign.schema.json",
        "# The flight of a log, again.  wil-campaign run campaign.yaml",
        *_facts(flight, course, log),
        "schema: wil/campaign/1",
        f"campaign: {yaml_of_word(name)}",
        f"description: Fly the course of {_quoted_in(printable_problem(log.name))}",
        "",
        "vehicles:",
        "  real:                       # embedded until you attach one: link: udpin://0.0.0.0:14550",
        "    link: embedded",
        *_vehicle(flight, autopilot, own, yaw),
        "  twin:",
        "    link: embedded",
        *_vehicle(flight, autopilot, own, yaw),
        "",
        "world: world.yaml",
        *_goal(course),
        "",
        "cases:",
        "  logged: {}",
        "  # Variants around the flight: wind, a weaker motor, other parameters. For example:",
        "  # gusty: {vehicles.real.profile: cage}",
        "modes: [sim, real]            # wil needs sensors and a recipe: docs/recipes.md",
        "repetitions: 1",
        "seed: 1",
        "",
        *_limits(course),
    ]
    return "\n".join(lines) + "\n"


def _facts(flight: LoggedFlight, course: FlightCourse | None, log: Path) -> Iterator[str]:
    yield f"# From {printable_problem(str(log))}: {flight.kind}."
    vehicle = flight.vehicle_type or "unknown; only multicopters are flown"
    yield f"# vehicle: {printable_problem(vehicle)}"
    if flight.autopilot is None:
        yield "# autopilot: unknown; px4 is a guess"
    yield f"# firmware: {printable_problem(flight.firmware) or 'unknown'}"
    if flight.vehicle_type not in {"", "quadrotor"}:
        yield "# The embedded vehicle is a quadrotor: it stands in for this one."
    if course is None:
        yield "# course: unknown: no position, or the vehicle never left the ground"
    else:
        yield f"# flown: {course.duration_s:.1f} s" + (
            f"; the longest of {course.flights} flights" if course.flights > 1 else ""
        )
    for problem in (*flight.problems, *(() if course is None else course.problems)):
        yield f"# {printable_problem(problem)}"


def _vehicle(
    flight: LoggedFlight, autopilot: str, profile: str, yaw_deg: float | None
) -> Iterator[str]:
    yield f"    autopilot: {autopilot}"
    yield f"    profile: {profile}"
    if profile == _PROFILE:
        yield "    body: {width_m: 0.3, height_m: 0.1}  # propellers included, feet to top"
    remark = "" if yaw_deg is not None else "  # its heading is unknown"
    yield f"    start: {{north_m: 0, east_m: 0, up_m: 0, yaw_deg: {yaw_deg or 0.0:.1f}}}{remark}"
    yield "    pose_source: mavlink"
    moving = dict(_moving_parameters(flight, autopilot))
    if moving:
        yield f"    params:                   # where they differ; all are in {autopilot}.params"
        for name, value in moving.items():
            yield f"      {name}: {value:g}"
    elif not flight.parameters:
        yield "    # params: unknown"


def _moving_parameters(flight: LoggedFlight, autopilot: str) -> Iterator[tuple[str, float]]:
    """Yield the parameters of motion that the embedded vehicle has with other values."""
    known = default_parameters(autopilot)
    for name, value in sorted(flight.parameters.items()):
        default = known.get(name)
        if default is None or not name.startswith(autopilot_named(autopilot).motion_parameters):
            continue
        if math.isfinite(value) and not math.isclose(value, default, rel_tol=1e-5, abs_tol=1e-9):
            yield name, value


def _goal(course: FlightCourse | None) -> Iterator[str]:
    """Yield the autonomy and the goal: the course, or hovering."""
    yield "autonomy:"
    yield "  use: autonomy.py:Autonomy"
    yield "  with:"
    yield "    waypoints:                # north, east, up in metres from the start; speed in m/s"
    if course is None or not course.waypoints:
        yield f"      - [{_AHEAD_M:g}, 0, {_UP_M:g}, 0.5]        # unknown: it flies ahead"
        yield f"goal: {{altitude_m: {_UP_M:g}, position: {_position(_AHEAD_M, 0, _UP_M)}}}"
        return
    for point in course.waypoints:
        yield f"      - [{point.north_m:g}, {point.east_m:g}, {point.up_m:g}, {point.speed_m_s:g}]"
    last = course.waypoints[-1]
    position = _position(last.north_m, last.east_m, last.up_m)
    yield f"goal: {{altitude_m: {course.altitude_m:g}, position: {position}}}"


def _position(north_m: float, east_m: float, up_m: float) -> str:
    return f"{{north_m: {north_m:g}, east_m: {east_m:g}, up_m: {up_m:g}}}"


def _limits(course: FlightCourse | None) -> Iterator[str]:
    box = ((-5, 5), (-5, 5), (-2, 8)) if course is None else course.box
    sides = zip(("north_m", "east_m", "up_m"), box, strict=True)
    text = ", ".join(f"{key}: [{low:g}, {high:g}]" for key, (low, high) in sides)
    limit_s = 60.0 if course is None else math.ceil(1.5 * course.duration_s + 30.0)
    yield "geofence:"
    yield f"  box: {{{text}}}" + (
        "   # a guess" if course is None else "   # 5 m around the course"
    )
    yield "oracles:"
    yield "  reached_position: {tolerance_m: 1.0}"
    yield f"  time_limit: {{limit_s: {limit_s:g}}}"
    yield "  geofence: {}"
    yield "  vehicle_fault: {}"
    yield "  landed: {}"


def _world(flight: LoggedFlight, course: FlightCourse | None) -> str:
    """Return the world file: open ground, at the place where the vehicle stood."""
    lines = [
        "# yaml-language-server: $schema=schemas/world.schema.json",
        "# Open ground; the origin is where the vehicle stood before its takeoff.",
        "schema: wil/world/1",
    ]
    place = _start_place(flight, course)
    if place is None:
        lines.append("# The log has no place on Earth; this is PX4's default:")
        lines.append(_origin_text(_UNTOLD))
    else:
        lines.append(_origin_text(place))
    lines += [
        "ground_up_m: 0",
        "# objects:                    # what stands there, or only in the virtual world",
        "#   box: {shape: {box: {size_m: [2, 2, 3]}}, pose: {north_m: 7, east_m: 0, up_m: 1.5}}",
    ]
    return "\n".join(lines) + "\n"


def _origin_text(place: Geodetic) -> str:
    degrees = f"latitude_deg: {place.latitude_deg:.7f}, longitude_deg: {place.longitude_deg:.7f}"
    return f"origin: {{{degrees}, altitude_m: {place.altitude_m:.2f}}}"


def _start_place(flight: LoggedFlight, course: FlightCourse | None) -> Geodetic | None:
    origin = flight.origin
    if origin is None or course is None:
        return origin
    frame = LocalFrame(origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
    start = course.start
    return frame.to_geodetic((start.north_m, start.east_m, -start.up_m))


def _autonomy() -> str:
    return (files("wil_campaign.plugins.logs") / "course_autonomy.py.in").read_text("utf-8")


def _parameter_file(flight: LoggedFlight) -> str:
    """Return all parameters, as ground stations read them: a name and a value in a line."""
    rows = [f"{name},{value:.9g}" for name, value in sorted(flight.parameters.items())]
    head = "# Parameters of the log's vehicle" if rows else "# The log has no parameters"
    return "\n".join([head, *rows]) + "\n"


def _profile(battery: BatteryKeys | None, log: Path) -> str:
    """Return the starter's profile with what the log tells of the battery."""
    starter = files("wil_campaign.plugins.start") / "starter" / "profile.yaml.in"
    name = printable_problem(log.name)
    known = {} if battery is None else battery.values
    text = starter.read_text("utf-8").replace("@NAME@", _quoted_in(name))
    for key, value in known.items():
        text = re.sub(rf"(?m)^(  {key}: )\S+", rf"\g<1>{value}", text)
    stated = f"battery {', '.join(known)}" if known else "nothing of the battery"
    if battery is not None and battery.guessed:
        stated += f"; its {battery.guessed} cells are a guess, by the greatest voltage"
    return f"# From {name}: {stated}. The rest is not in a log.\n{text}"


def _quoted_in(text: str) -> str:
    """Return a text that may stand in a plain YAML value."""
    return "".join(char if char.isalnum() or char in "._- " else "_" for char in text)
