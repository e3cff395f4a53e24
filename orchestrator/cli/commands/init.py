"""`wil-campaign init`: writes a campaign that is ready to fly, as a starting point."""

import re
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from orchestrator.cli.commands.schema import schema_texts
from orchestrator.cli.standard_streams import err, out
from orchestrator.model.document_writer import write_whole
from worlds.files.problems import printable

_FILES = {
    "campaign.yaml.in": "campaign.yaml",
    "world.yaml.in": "world.yaml",
    "recipe.yaml.in": "recipe.yaml",
    "autonomy.py.in": "autonomy.py",
    "github-workflow.yml.in": ".github/workflows/wil-campaign.yml",
}
_SCHEMAS = "schemas"
"""The folder of the JSON Schemas that the first lines of the files name, for editors."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


def init(name: str, *, folder: Annotated[Path | None, Parameter(name="--in")] = None) -> int:
    """Write a campaign that is ready to fly: campaign, world, recipe, autonomy, CI workflow.

    JSON Schemas are written beside them, with which editors complete and explain the files.

    No file is overwritten. Exit code 2: the name is not valid for a folder, or a file exists
    already; 3: the files cannot be written.

    Parameters
    ----------
    name
        The campaign's name.
    folder
        Where the files go; by default a new folder of that name.
    """
    if not _NAME.fullmatch(name):
        err(
            printable(f"'{name}' becomes a folder: use up to 64 of A-Z a-z 0-9 . _ - and begin ")
            + "with one of the letters or digits"
        )
        return 2
    place = Path(name) if folder is None else folder
    texts = {target: _filled(source, name) for source, target in _FILES.items()}
    texts |= {f"{_SCHEMAS}/{file}": text for file, text in schema_texts().items()}
    if there := [one for one in texts if (place / one).exists()]:
        err(printable(f"{place} has {', '.join(there)} already; nothing was written"))
        return 2
    try:
        for target, text in texts.items():
            path = place / target
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, text)
    except OSError as error:
        err(printable(f"{place} cannot be written: {error.strerror or error}"))
        return 3
    for target in texts:
        out(printable(str(place / target)))
    out("")
    out(printable(f"next: wil-campaign run {place / 'campaign.yaml'}"))
    return 0


def _filled(source: str, name: str) -> str:
    """Return a starter file with the campaign's name."""
    text = (files("orchestrator.cli") / "starter" / source).read_text("utf-8")
    return text.replace("@NAME@", name)
