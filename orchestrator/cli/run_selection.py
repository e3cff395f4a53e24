"""The options that choose which runs of a campaign there are; of several commands."""

from dataclasses import dataclass
from typing import Annotated

from cyclopts import Parameter

from campaigns.expansion.expansion import Options


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The selection of runs on the command line: cases, modes, overrides.

    Parameters
    ----------
    case
        Only cases that match this GLOB; may be given several times.
    mode
        Only this mode: sim, wil or real; may be given several times.
    repetitions
        How often each case is flown in each mode.
    seed
        The seed from which those of the runs derive.
    set_
        KEY=VALUE: a dotted key of the campaign, or of world.* or recipe.*, and its value.
    """

    case: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    mode: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    repetitions: int | None = None
    seed: int | None = None
    set_: Annotated[tuple[str, ...], Parameter(name="--set", negative=())] = ()

    def options(self, *further: str) -> Options:
        """Return the run selection as options with further KEY=VALUE after it."""
        return Options(
            cases=self.case,
            modes=self.mode,
            repetitions=self.repetitions,
            seed=self.seed,
            sets=(*self.set_, *further),
        )


ALL = Choice()
