"""An autonomy that is a program: what a campaign says of it, and its checks."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from wil_campaign.campaigns.setup.autonomy_under_test import ForeignAutonomy
from wil_campaign.foundation.files.documents import Document, Problem
from wil_campaign.foundation.files.paths import is_file

_SUMMARY = "Instead, a program with its arguments, run in the folder of this file."


def program_field() -> tuple[Any, Any]:
    """Return the type and the field of the key `program`."""
    kind = Annotated[list[str], Field(min_length=1)] | None
    return kind, Field(default=None, description=_SUMMARY)


@dataclass(frozen=True, slots=True)
class ProgramAutonomy(ForeignAutonomy):
    """An autonomy program: command and arguments, run in the folder of the campaign."""

    command: tuple[str, ...]

    @property
    def kind(self) -> str:
        """Return the key of `autonomy` that names a program."""
        return "program"

    @property
    def text(self) -> str:
        """Return the program in messages."""
        return f"the program {self.command[0]}"

    def problems(self, file: Document, folder: Path) -> list[Problem]:
        """Return the problem of a program that is missing or not executable."""
        program = self.command[0]
        found = folder / program if "/" in program else shutil.which(program)
        path = ("autonomy", "program", 0)
        if found is None:
            return [file.problem(path, f"there is no program '{program}' in PATH")]
        if not is_file(Path(found)):
            return [file.problem(path, f"there is no file '{program}' beside the campaign")]
        if not os.access(found, os.X_OK):
            remedy = "chmod +x it, or name its interpreter before it"
            return [file.problem(path, f"'{program}' is not executable: {remedy}")]
        return []


def program_autonomy(command: list[str]) -> ProgramAutonomy:
    """Return the autonomy that a campaign's `program` names."""
    return ProgramAutonomy(tuple(command))
