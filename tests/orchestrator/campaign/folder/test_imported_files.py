"""What users' files import, found without running them."""

import sys
from pathlib import Path

import pytest

from wil_campaign.orchestrator.campaign.folder.imported_files import files_imported_by


def test_imports_are_followed_and_nothing_is_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    package = tmp_path / "lab_of_ours"
    package.mkdir()
    (package / "__init__.py").write_text("raise RuntimeError\n")
    (package / "gains.py").write_text("import numpy as np\nfrom lab_of_ours import deeper\n")
    (package / "deeper.py").write_text("import json, wil_campaign.vehicles.autonomy\n")
    autonomy = tmp_path / "autonomy.py"
    autonomy.write_text("def later():\n    from lab_of_ours.gains import K\n    import nowhere\n")
    found = files_imported_by({autonomy})
    assert {path.name for path in found.files} >= {"gains.py", "deeper.py"}
    assert autonomy not in found.files
    assert found.packages == {"numpy"}
    assert "lab_of_ours" not in sys.modules


@pytest.mark.parametrize("text", ["def (", "\0"])
def test_a_file_that_cannot_be_parsed_imports_nothing(tmp_path: Path, text: str) -> None:
    (tmp_path / "broken.py").write_text(text)
    assert files_imported_by({tmp_path / "broken.py"}).files == frozenset()
