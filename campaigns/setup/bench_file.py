"""A bench as campaigns use it, from its file."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.campaigns.schema.bench import OF_VEHICLE, BenchPart, PropertyValue
from wil_campaign.campaigns.schema.vehicles import VehiclesPart
from wil_campaign.campaigns.setup.case_files import fence_files
from wil_campaign.campaigns.setup.vehicle_fences import FenceDrawing, fences_of_vehicles
from wil_campaign.campaigns.setup.vehicle_setups import VehicleSetup, vehicle_setups
from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    Problem,
    check_document,
    load_document,
)
from wil_campaign.foundation.files.problems import printable_problem


@dataclass(frozen=True, slots=True)
class BenchFacts:
    """Name and properties by which a campaign asks for a bench; `autopilot` is one of these."""

    name: str
    properties: Mapping[str, PropertyValue]

    def __str__(self) -> str:
        """Return the bench's name with its properties, in words."""
        listed = ", ".join(
            f"{key}: {property_text_in_file(one)}" for key, one in sorted(self.properties.items())
        )
        return f"{self.name} ({listed})"


@dataclass(frozen=True, slots=True)
class Bench:
    """A place with a real vehicle, from its file.

    users: the users that may consent to arm there; None: any user at its terminal. vehicle: the
    real one.
    """

    facts: BenchFacts
    document: Document
    users: tuple[str, ...] | None
    vehicle: VehicleSetup

    @property
    def name(self) -> str:
        """Return the bench's name."""
        return self.facts.name

    def may_arm(self, user: str) -> bool:
        """Return whether a user of the bench's machine may consent to arm."""
        return self.users is None or user in self.users


def property_text_in_file(value: PropertyValue) -> str:
    """Return a property's value as it is written in a file."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def read_bench(document: Document) -> Bench:
    """Return the bench of a file's document. Raises BadInput with every problem."""
    part = check_document(document, BenchPart)
    problems: list[Problem] = []
    vehicles = vehicle_setups(document, VehiclesPart(real=part.vehicles.real), problems)
    drawing = FenceDrawing(document, fence_files(document, problems), None)
    if not problems:
        # Areas on Earth are converted later, with the geographic origin of a campaign's world.
        fences_of_vehicles(part.geofence, drawing, ("geofence",))
    if problems:
        raise BadInput(problems)
    return Bench(
        facts=BenchFacts(part.bench, {**part.properties, OF_VEHICLE: part.vehicles.real.autopilot}),
        document=document,
        users=None if part.arming.users is None else tuple(part.arming.users),
        vehicle=vehicles["real"],
    )


def load_benches(paths: Iterable[Path]) -> tuple[Bench, ...]:
    """Return the benches of files. Raises BadInput with every problem, also of equal names."""
    found: list[Bench] = []
    problems: list[Problem] = []
    for path in paths:
        try:
            found.append(read_bench(load_document(path)))
        except BadInput as error:
            problems += error.problems
    problems += equal_bench_names(found)
    if problems:
        raise BadInput(problems)
    return tuple(found)


def equal_bench_names(benches: Iterable[Bench]) -> Iterator[Problem]:
    """Yield a problem for each bench that has the name of an earlier one."""
    first: dict[str, Bench] = {}
    for bench in benches:
        other = first.setdefault(bench.name, bench)
        if other is not bench:
            line, column = other.document.place(("bench",))
            where = printable_problem(f"{other.document.name}:{line}:{column}")
            message = f"{where} is another bench named '{bench.name}'; rename one of them"
            yield bench.document.problem(("bench",), message)
