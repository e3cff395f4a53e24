"""Files that travel: whole, with what they name, and found beneath another folder."""

from dataclasses import replace
from pathlib import Path

import pytest

from campaigns.expansion.expansion import load_campaign
from orchestrator.campaign.folder.manifest import read_files
from orchestrator.campaign.resuming.run_ledger import RunLedger, newest_session
from orchestrator.engines.travelling_files import (
    DamagedFileError,
    TravellingFiles,
    pack_files,
    place_beneath,
    relocate_order,
    resolve_order,
    unpack_files,
)
from orchestrator.state.run_setup import RunOrder
from tests.orchestrator.hover import write_hover
from worlds.files.documents import BadInput


def test_a_campaign_is_read_where_it_was_unpacked_and_nowhere_else(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    campaign = load_campaign(write_hover(here))
    sent = pack_files(read_files(campaign), [str(here), "/nowhere"])
    unpack_files(sent, there)
    plan = campaign.runs[0]
    order = resolve_order(RunOrder(plan=plan, folder=tmp_path / "out", clock="virtual"))
    (here / "still.py").unlink()
    moved = relocate_order(order, there)
    assert moved.plan.files.campaign.path == place_beneath(there, here.resolve() / "hover.yaml")
    assert moved.plan.setup()
    place_beneath(there, here.resolve() / "still.py").unlink()
    with pytest.raises(BadInput, match=r"there is no file 'still\.py'"):
        moved.plan.setup()
    assert sent.search_path == (here.resolve(),)
    assert {one.path.name for one in sent.files} == {"hover.yaml", "still.py", "world.yaml"}


def test_a_damaged_file_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("sent")
    sent = pack_files([tmp_path / "a.txt"], [])
    damaged = TravellingFiles(tuple(replace(one, content=b"came") for one in sent.files))
    with pytest.raises(DamagedFileError, match=r"a\.txt arrived damaged"):
        unpack_files(damaged, tmp_path / "there")
    assert not (tmp_path / "there").exists()


def test_materials_and_pictures_of_a_mesh_travel_with_it(tmp_path: Path) -> None:
    (tmp_path / "box.obj").write_text("mtllib my box.mtl\nv 0 0 0\n")
    (tmp_path / "my box.mtl").write_text("newmtl a\nmap_Kd -s 1 1 1 skin.png\nmap_Kd gone.png\n")
    (tmp_path / "skin.png").write_bytes(b"png")
    (tmp_path / "other.png").write_bytes(b"png")
    sent = pack_files([tmp_path / "box.obj"], [])
    assert {one.path.name for one in sent.files} == {"box.obj", "my box.mtl", "skin.png"}


def test_programs_stay_programs(tmp_path: Path) -> None:
    program = tmp_path / "program"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    unpack_files(pack_files([program], []), tmp_path / "there")
    assert place_beneath(tmp_path / "there", program).stat().st_mode & 0o111


def test_the_newest_start_of_a_campaign_holds_also_behind_a_line_that_was_cut(
    tmp_path: Path,
) -> None:
    assert newest_session(tmp_path) == ""
    RunLedger(tmp_path, "first").write("ordered", "a/sim/1", "node")
    RunLedger(tmp_path, "second")
    with (tmp_path / "ledger.jsonl").open("a") as file:
        file.write('{"session": "third", "ev')
    assert newest_session(tmp_path) == "second"
