"""What the safety of a flight hangs on, said wrongly: exit 2, the place, and no folder."""

import errno
import os
import pwd
import re
import tempfile
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.orchestrator.campaign.workers import run_server
from wil_campaign.orchestrator.cli import main
from wil_campaign.safety.guard.process.runtime_folder import RuntimeFolderError
from wil_campaign.vehicles.launch import path_beside_campaign

BOX = "geofence: {box: {north_m: [-3, 3], east_m: [-3, 3], up_m: HERE}}"
AREA = "geofence: {include: [{HERE}], up_m: [-1, 3]}"


def box(up_m: str) -> str:
    return BOX.replace("HERE", up_m)


def area(drawn: str) -> str:
    return AREA.replace("HERE", drawn)


WRONG = [
    # what is appended to a good campaign, or replaces its oracles; what is said, at "^"
    (area("polygon: ^[[0, -1], [2, 1], [2, -1], [0, 1]]"), "crosses itself at north 1 m, east 0 m"),
    (area("polygon: ^[]"), "a polygon needs 3 different corners, has 0"),
    (area("polygon_deg: [^[98.5, 47], [98.5, 48], [97, 47]]"), "latitude 98.5 is beyond"),
    (area("circle: {north_m: 0, east_m: 0, radius_m: ^.inf}"), "must be finite"),
    (box("[0.5, 3]"), "'twin' starts 0.50 m outside of the geofence's floor"),
    (box("^[3, -1]"), "must be [low, high], is [3, -1]"),
    (box("[-1, ^.nan]"), "(it must be finite)"),
    ("oracles: {landed: {}, ^colission: {}}", "unknown oracle 'colission'; did you mean"),
    ("oracles: {landed: {}, altitude: {^max: 2}}", "unknown key 'max'; did you mean 'max_m'?"),
    ("oracles: {landed: {}, altitude: {max_m: ^2 m}}", "a plain number; the key has"),
    ("oracles: {landed: {}, s: {stl: 'always (^hight_m > 1)'}}", "unknown signal 'hight_m'"),
    ("oracles: {landed: {}, s: {stl: 'always[0,30 ^(up_m > 1)'}}", "']'"),
]


@pytest.mark.parametrize(("marked", "said"), WRONG)
def test_bad_input_is_exit_2_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], marked: str, said: str
) -> None:
    path = write_hover(tmp_path)
    line = marked.replace("^", "")
    kept = [
        text
        for text in path.read_text().splitlines()
        if not (line.startswith("oracles") and text.startswith("oracles"))
    ]
    path.write_text("\n".join([*kept, line]) + "\n")
    out = tmp_path / "out"
    assert main(["run", str(path), "--out", str(out)]) == 2
    told = capsys.readouterr().err
    places = re.findall(r"hover\.yaml:(\d+):(\d+): (.*)", told)
    # A fence that leaves a vehicle out is told where the vehicle stands.
    marks = "^" in marked
    place = (str(len(kept) + 1), str(marked.index("^") + 1)) if marks else ("3", "12")
    assert [place for *place_, words in places if said in words and tuple(place_) == place], told
    assert not out.exists()


NOT_UTF8 = os.fsdecode(b"n\xff")


@pytest.mark.parametrize(
    ("out", "said"),
    [
        (NOT_UTF8, f"the name '{NOT_UTF8.encode(errors='backslashreplace').decode()}' in its path"),
        ("x" * 256, "is too long for a folder of results"),
        ("/".join(["x" * 200] * 20), "is too long for a folder of results"),
    ],
    ids=["not UTF-8", "a long name", "a long path"],
)
def test_results_are_not_put_where_no_path_is_possible(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], out: str, said: str
) -> None:
    path = write_hover(tmp_path)
    assert main(["run", str(path), "--out", str(tmp_path / out)]) == 2
    assert said in capsys.readouterr().err
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize("command", ["run", "validate", "plan"])
def test_a_campaign_in_a_folder_that_is_not_utf8_is_refused(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
) -> None:
    (tmp_path / NOT_UTF8).mkdir()
    path = write_hover(tmp_path / NOT_UTF8)
    monkeypatch.chdir(path.parent)
    assert main([command, path.name]) == 2
    printed = capsys.readouterr()
    assert "hover.yaml: the name 'n" in printed.out + printed.err
    assert "is not UTF-8: rename it" in printed.out + printed.err
    assert len(list(path.parent.iterdir())) == 3


def test_a_folder_that_may_not_be_entered_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also as the current folder, beneath which results go; root may enter each."""
    path = write_hover(tmp_path)
    stat = Path.stat

    def denied(self: Path, *, follow_symlinks: bool = True) -> os.stat_result:
        if self.name in {"locked", "results"}:
            raise PermissionError(errno.EACCES, "Permission denied", str(self))
        return stat(self, follow_symlinks=follow_symlinks)

    monkeypatch.setattr(Path, "stat", denied)
    monkeypatch.setattr(tempfile, "TemporaryDirectory", refuse)
    assert main(["run", str(path), "--out", str(tmp_path / "results")]) == 3
    assert "results cannot be written to" in capsys.readouterr().err
    assert main(["run", str(tmp_path / "locked")]) == 2
    assert "locked: cannot be read: Permission denied" in capsys.readouterr().err


def refuse(*_: object, **__: object) -> None:
    raise PermissionError(errno.EACCES, "Permission denied")


def test_no_safe_folder_for_sockets_ends_in_a_sentence_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def unsafe() -> None:
        raise RuntimeFolderError("no safe folder for sockets: set XDG_RUNTIME_DIR")

    monkeypatch.setattr(run_server, "open_runtime_folder", unsafe)
    assert main(["run", str(write_hover(tmp_path)), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == "no safe folder for sockets: set XDG_RUNTIME_DIR\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("home", ["~nobody-of-this-name/x", "~/x"])
def test_a_home_that_is_not_there_is_a_name_like_any_other(
    monkeypatch: pytest.MonkeyPatch, home: str
) -> None:
    def unknown(uid: int) -> None:
        raise KeyError(uid)

    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    assert path_beside_campaign(Path("/campaign"), home) == Path("/campaign") / home
