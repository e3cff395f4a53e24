"""Imports of internal modules by files of users, reported with the public name."""

from pathlib import Path

import pytest

from tests.orchestrator.hover import STILL, write_hover
from wil_campaign.campaigns.expansion.expansion import load_campaign

READINGS = "wil_campaign.vehicles.readings"
PUBLIC = "`python -m pydoc wil_campaign.api` shows what is public"


@pytest.mark.parametrize(
    ("line", "remedy"),
    [
        (f"from {READINGS} import CameraReading", "from wil_campaign.api import CameraReading"),
        (f"import {READINGS}", PUBLIC),
        ("from wil_campaign.worlds import frames", PUBLIC),
        ("from wil_campaign import vehicles", PUBLIC),
        (
            "from wil_campaign.orchestrator.run_results.run_result import RunResult",
            "from wil_campaign import RunResult",
        ),
        ("from wil_campaign.api import CameraReading, Pose", ""),
        ("import wil_campaign.api", ""),
        ("import wil_campaign", ""),
        ("from wil_campaign import RunResult, api", ""),
        ("import vehicles", ""),
    ],
)
def test_an_import_from_deeper_is_reported_with_the_public_name(
    tmp_path: Path, line: str, remedy: str
) -> None:
    """Of a module beside the autonomy, too."""
    path = write_hover(tmp_path)
    public = STILL.replace("wil_campaign.vehicles.autonomy", "wil_campaign.api").replace(
        "wil_campaign.vehicles.setpoints", "wil_campaign.api"
    )
    (tmp_path / "still.py").write_text(f"import helper\n{public}")
    (tmp_path / "helper.py").write_text(f"\n{line}\n")
    (tmp_path / "vehicles.py").touch()
    found = [
        (warning.file, warning.line, warning.message.rpartition(": ")[2])
        for warning in load_campaign(path).warnings
        if "internal to wil-campaign" in warning.message
    ]
    assert found == ([(str(tmp_path / "helper.py"), 2, remedy)] if remedy else [])
