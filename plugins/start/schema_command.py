"""`wil-campaign schema`: JSON Schemas for editors."""

import json
from pathlib import Path

from wil_campaign.foundation.files.document_writer import write_atomically
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.plugins.start.json_schemas import SCHEMAS


def schema(folder: Path = Path("schemas")) -> int:
    """Write the JSON Schemas of campaign, world, recipe and bench files, for completion and hover.

    Exit code 3: the files cannot be written.

    Parameters
    ----------
    folder
        Where the files go; older ones of the same names are replaced.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in schema_texts().items():
            write_atomically(folder / name, text)
            write_stdout(printable_problem(str(folder / name)))
    except OSError as error:
        write_stderr(printable_problem(f"{folder} cannot be written: {error.strerror or error}"))
        return 3
    return 0


def schema_texts() -> dict[str, str]:
    """Return the text of each file of a schema."""
    return {
        name: json.dumps(make(), indent=1, ensure_ascii=False) + "\n"
        for name, make in SCHEMAS.items()
    }
