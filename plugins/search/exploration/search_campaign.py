"""The campaign of a search: variants as planned runs, and the check of whether one can be flown."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from wil_campaign.campaigns.expansion.case_reader import read_setup
from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan
from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.bench_file import Bench
from wil_campaign.campaigns.setup.bench_resolution import bench_completion
from wil_campaign.campaigns.setup.case_files import CaseFiles, case_files
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.setup.overrides import Override
from wil_campaign.campaigns.values.seeds import run_seed
from wil_campaign.foundation.files.documents import BadInput, Document, parse_option_value
from wil_campaign.plugins.search.exploration.model import (
    FlightBatch,
    SearchFlightPlan,
    SearchProblem,
    SearchVariant,
)
from wil_campaign.plugins.search.exploration.objective import SearchObjective
from wil_campaign.plugins.search.exploration.space import SearchSpace, Values
from wil_campaign.plugins.search.search_part import ParameterValue, SearchPart


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchCampaign:
    """A campaign with a search, checked. campaign: as it is flown without a search.

    document: its file after the options, without the search and without the values of its bench.
    case: the one that is varied; case_overrides: its overrides; option_overrides: those of the
    command line.
    """

    campaign: Campaign
    document: Document
    part: SearchPart
    case: str
    case_overrides: tuple[Override, ...]
    option_overrides: tuple[Override, ...]
    space: SearchSpace
    objective: SearchObjective

    def problem(self, *, at_once: int) -> SearchProblem:
        """Return the task of the search. at_once: flights that fly at once."""
        part = self.part
        return SearchProblem(
            space=self.space,
            budget=part.flights_by_mode,
            refuse=self.refuse,
            seeds=part.seeds,
            confirm_flights=part.confirm.flights,
            votes=part.confirm.votes,
            confirm_most=part.confirm.most,
            reduce_flights=part.reduce,
            stop_after=part.stop_after,
            at_once=at_once,
        )

    def overrides(self, values: Values) -> dict[str, ParameterValue]:
        """Return values by the dotted keys that they change."""
        return {
            key: values[parameter.name]
            for parameter in self.space.parameters
            if parameter.name in values
            for key in parameter.keys
        }

    def files(self, variant: SearchVariant) -> CaseFiles:
        """Return the files of a variant. Raises BadInput."""
        changed = tuple(
            override_by_parameter(*override) for override in self.overrides(variant.values).items()
        )
        overrides = (*self.case_overrides, *self.option_overrides, *changed)
        files, problems = case_files(self.document, overrides, bench_completion(self._bench))
        if problems:
            raise BadInput(problems)
        return files

    def refuse(self, variant: SearchVariant) -> str:
        """Return why a variant cannot be flown; "" where it can.

        Its start may be outside of the fence or inside an object, or its campaign invalid.
        """
        try:
            read_setup(self.files(variant), tuple(self.part.flights_by_mode))
        except BadInput as error:
            return error.problems[0].message
        return ""

    def batch_campaign(self, batch: FlightBatch) -> Campaign:
        """Return a batch of flights as a campaign in which each variant is a case.

        It has no requirements and no controls; a case has as many repetitions as it has flights.
        """
        variants = {flight.variant.name: flight.variant for flight in batch.flights}
        files = {name: self.files(variant) for name, variant in variants.items()}
        setups: Mapping[str, Case] = {
            name: read_setup(file, (batch.mode,)) for name, file in files.items()
        }
        base = self.campaign
        of_benches = [bench.document.path for bench in base.benches]
        return replace(
            base,
            document=bench_completion(self._bench)(self.document),
            paths=tuple(
                dict.fromkeys([*(p for f in files.values() for p in f.paths), *of_benches])
            ),
            cases=tuple(variants),
            modes=(batch.mode,),
            repetitions=max(flight.repetition for flight in batch.flights),
            setups=setups,
            runs=tuple(self._plan(flight, files[flight.variant.name]) for flight in batch.flights),
            requirements=(),
            left_out=(),
            test=None,
            controls=(),
            warnings=(),
        )

    def _plan(self, flight: SearchFlightPlan, files: CaseFiles) -> RunPlan:
        seed = self.seed(flight)
        return RunPlan(
            campaign=self.campaign.name,
            case=flight.variant.name,
            mode=flight.mode,
            repetition=flight.repetition,
            seed=seed,
            required=False,
            files=files.seeded(seed),
            retries=self.campaign.runs[0].retries,
            loads_code=self.campaign.options.loads_code,
        )

    def seed(self, flight: SearchFlightPlan) -> int:
        """Return the seed of a flight."""
        return run_seed(self.campaign.seed, flight.seed_name, flight.repetition)

    @property
    def flown(self) -> Campaign:
        """Return the campaign with the case and the modes that the search flies, as planned."""
        runs = tuple(plan for plan in self.campaign.runs if plan.case == self.case)
        return replace(self.campaign, modes=tuple(self.modes), runs=runs, controls=())

    @property
    def _bench(self) -> Bench | None:
        """Return the bench whose vehicle and fence the campaign has; None without one."""
        return next(iter(self.campaign.benches), None)

    @property
    def modes(self) -> Sequence[Mode]:
        """Return the modes that the search flies, the cheapest first."""
        return tuple(self.part.flights_by_mode)


def override_by_parameter(key: str, value: ParameterValue) -> Override:
    """Return the override of a dotted key by a parameter's value."""
    text = json.dumps(value, ensure_ascii=False)
    return Override(key, parse_option_value(text, name=f"search {key}={text}"))
