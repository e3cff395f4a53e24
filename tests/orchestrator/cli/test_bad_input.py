"""What the safety of a flight hangs on, said wrongly: exit 2, the place, and no folder."""

import re
from pathlib import Path

import pytest

from orchestrator.cli import main
from tests.orchestrator.hover import write_hover

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
def test_exit_2_with_the_place(
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
