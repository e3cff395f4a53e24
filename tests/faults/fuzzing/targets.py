"""What a fuzzer feeds: every decoder of users' files, and every port that strangers reach."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

Take = Callable[[bytes], object]
"""Takes one input; raises the target's refusals, and nothing else."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """A target that is ready: valid inputs, which are mutated, and what takes one."""

    seeds: Sequence[bytes]
    take: Take


@dataclass(frozen=True, slots=True)
class Target:
    """A decoder or port. refusals: what it raises for bad input. prepare: gets a folder."""

    name: str
    refusals: tuple[type[Exception], ...]
    prepare: Callable[[Path], Prepared]
    takes_seeds: bool = True
    """False where it refuses them too: they are commands of somebody who may give none."""


def by_file(folder: Path, suffix: str, take: Callable[[Path], object]) -> Take:
    """Return what writes an input to a file and takes that."""
    path = folder / f"input{suffix}"

    def taken(data: bytes) -> object:
        path.write_bytes(data)
        return take(path)

    return taken
