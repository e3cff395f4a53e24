"""Command-line options that select the runs of a campaign; used by several commands."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

from cyclopts import Parameter

from wil_campaign.campaigns.expansion.expansion import ExpansionOptions
from wil_campaign.campaigns.setup.bench_file import load_benches


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class RunSelection:
    """The selection of runs on the command line: cases, modes, overrides.

    Parameters
    ----------
    case
        Only cases that match this GLOB; may be given several times.
    mode
        Only this mode: sim, wil or real; may be given several times.
    repetitions
        How often each case is flown in each mode, if not as often as the file says.
    seed
        The seed from which those of the runs derive.
    set_
        KEY=VALUE: a dotted key of the campaign, or of world.* or recipe.*, and its value.
    bench_file
        A bench of this machine, for a campaign that asks for one; may be given several times.
    """

    case: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    mode: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    repetitions: int | None = None
    seed: int | None = None
    set_: Annotated[tuple[str, ...], Parameter(name="--set", negative=())] = ()
    bench_file: Annotated[tuple[Path, ...], Parameter(negative=())] = ()

    def options(self, *further: str) -> ExpansionOptions:
        """Return the run selection as options with further KEY=VALUE after it.

        Raises BadInput for the bench files.
        """
        return ExpansionOptions(
            cases=self.case,
            modes=self.mode,
            repetitions=self.repetitions,
            seed=self.seed,
            sets=(*self.set_, *further),
            is_autonomy_isolated=True,
            benches=load_benches(self.bench_file),
        )

    @property
    def words(self) -> tuple[str, ...]:
        """Return the selection as words of a command line."""
        many = {
            "--case": self.case,
            "--mode": self.mode,
            "--repetitions": () if self.repetitions is None else (self.repetitions,),
            "--seed": () if self.seed is None else (self.seed,),
            "--set": self.set_,
            "--bench-file": self.bench_file,
        }
        return tuple(
            word
            for option, values in many.items()
            for value in values
            for word in (option, str(value))
        )

    @classmethod
    def of(cls, options: ExpansionOptions) -> Self:
        """Return the selection of a campaign that was loaded by options."""
        return cls(
            case=options.cases,
            mode=options.modes,
            repetitions=options.repetitions,
            seed=options.seed,
            set_=options.sets,
            bench_file=tuple(bench.document.path for bench in options.benches),
        )


ALL = RunSelection()
