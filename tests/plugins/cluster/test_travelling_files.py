"""Files that travel: whole, with what they name, and found beneath another folder."""

import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.foundation.files.user_modules import user_files
from wil_campaign.orchestrator.campaign.folder.manifest import (
    campaign_manifest,
    files_read_by_campaign,
)
from wil_campaign.orchestrator.campaign.workers.run_order import resolve_order
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.plugins.cluster import ray_engine
from wil_campaign.plugins.cluster.travelling_files import (
    DamagedFileError,
    TravellingFiles,
    different_in_place,
    pack_files,
    place_beneath,
    relocate_order,
    unpack_files,
)


def test_a_campaign_is_read_where_it_was_unpacked_and_nowhere_else(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    campaign = load_campaign(write_hover(here))
    sent = pack_files(files_read_by_campaign(campaign), [str(here), "/nowhere"])
    unpack_files(sent, there)
    plan = campaign.runs[0]
    order = resolve_order(RunOrder(plan=plan, folder=tmp_path / "out", clock="virtual"))
    (here / "still.py").unlink()
    moved = relocate_order(order, there)
    assert moved.plan.files.campaign.path == place_beneath(there, here.resolve() / "hover.yaml")
    # A recording names the files of the campaign's own machine, which draws its images again.
    assert moved.own_path(moved.plan.files.campaign.path) == here.resolve() / "hover.yaml"
    assert moved.plan.setup()
    place_beneath(there, here.resolve() / "still.py").unlink()
    with pytest.raises(BadInput, match=r"there is no file 'still\.py'"):
        moved.plan.setup()
    assert sent.search_path == (here.resolve(),)
    assert {file.path.name for file in sent.files} == {"hover.yaml", "still.py", "world.yaml"}


def unpacked(campaign: Path, there: Path, search_path: Iterable[str] = ()) -> RunOrder:
    """Send a campaign's files there and return its first order as a node flies it."""
    loaded = load_campaign(campaign)
    unpack_files(pack_files(files_read_by_campaign(loaded), search_path), there)
    order = RunOrder(plan=loaded.runs[0], folder=there / "out", clock="virtual")
    return relocate_order(resolve_order(order), there)


def test_modules_beside_an_autonomy_travel_with_it(tmp_path: Path) -> None:
    """Also one that it imports in flight only, which no check has run."""
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "safety").mkdir(parents=True)
    path = write_hover(here)
    (here / "safety" / "__init__.py").write_text("from .gains import GAIN\n")
    (here / "safety" / "gains.py").write_text("GAIN = 1\n")
    (here / "later.py").write_text("GAIN = 1\n")
    late = "    def act(self, telemetry):\n        import later\n"
    text = (here / "still.py").read_text().replace("    def act(self, telemetry):\n", late)
    (here / "still.py").write_text(f"from safety import GAIN\n{text}")
    order = unpacked(path, there)
    shutil.rmtree(here)
    setup = order.plan.setup()
    setup.under_test.build(seed=0)
    beneath = place_beneath(there, here.resolve())
    assert (beneath / "later.py").exists()
    assert {user_file.name for user_file in user_files(beneath)} == {
        "still.py",
        "__init__.py",
        "gains.py",
    }


def test_a_file_travels_under_the_name_of_the_symlink_by_which_it_is_used(tmp_path: Path) -> None:
    """As links to a shared folder of models; also where the campaign is in a linked folder."""
    shared, here, there = (tmp_path / name for name in ("shared", "here", "there"))
    for folder in (shared, here / "own"):
        folder.mkdir(parents=True)
    campaign = write_hover(here)
    campaign.write_text(campaign.read_text().replace("still.py:", "../here/own/autonomy.py:"))
    (here / "still.py").rename(shared / "still-2.py")
    (here / "world.yaml").rename(shared / "world-2.yaml")
    (here / "own" / "autonomy.py").symlink_to(shared / "still-2.py")
    (here / "world.yaml").symlink_to(shared / "world-2.yaml")
    (tmp_path / "places" / "further").mkdir(parents=True)
    (tmp_path / "places" / "further" / "linked").symlink_to(here)
    for number, folder in enumerate((here, tmp_path / "places/further/linked")):
        order = unpacked(folder / "hover.yaml", there / str(number))
        # A linked folder is the one that it points to, as names in it by `..` mean.
        assert place_beneath(there / str(number), here / "own" / "autonomy.py").is_file()
        assert order.plan.setup()


def test_the_manifest_has_the_files_behind_symlinks(tmp_path: Path) -> None:
    campaign = write_hover(tmp_path)
    (tmp_path / "still.py").rename(tmp_path / "other.py")
    (tmp_path / "still.py").symlink_to("other.py")
    files = campaign_manifest(load_campaign(campaign), "virtual")["files"]
    assert isinstance(files, dict)
    assert set(files) == {"hover.yaml", "other.py", "world.yaml"}


def test_a_file_that_is_named_absolutely_has_to_be_the_same_on_the_node(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run reads it at its own place there, and not what has travelled."""
    campaign = write_hover(tmp_path)
    (tmp_path / "home").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    paths = {"elsewhere.py": tmp_path / "elsewhere.py", "net.onnx": tmp_path / "home" / "net.onnx"}
    (tmp_path / "still.py").rename(paths["elsewhere.py"])
    paths["net.onnx"].write_text("weights")
    named = f"{{use: '{paths['elsewhere.py']}:Still', with: {{model: ~/net.onnx}}}}"
    campaign.write_text(campaign.read_text().replace("still.py:Still", named))
    loaded = load_campaign(campaign)
    sent = pack_files(files_read_by_campaign(loaded), [], ray_engine.files_named_absolutely(loaded))
    assert [one.name for one in sent.in_place] == [paths["elsewhere.py"], Path("~/net.onnx")]
    assert different_in_place(sent) == ""
    for path, name in ((paths["net.onnx"], "~/net.onnx"), (paths["elsewhere.py"], "elsewhere.py")):
        content = path.read_text()
        path.write_text("another")
        assert f"{name} is not the file that it is" in different_in_place(sent)
        path.write_text(content)
    paths["elsewhere.py"].unlink()
    assert "or it is missing" in different_in_place(sent)


def test_a_damaged_file_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("sent")
    sent = pack_files([tmp_path / "a.txt"], [])
    damaged = TravellingFiles(tuple(replace(file, content=b"came") for file in sent.files))
    with pytest.raises(DamagedFileError, match=r"a\.txt arrived damaged"):
        unpack_files(damaged, tmp_path / "there")
    assert not (tmp_path / "there").exists()


def test_materials_and_pictures_of_a_mesh_travel_with_it(tmp_path: Path) -> None:
    (tmp_path / "box.obj").write_text("mtllib my box.mtl\nv 0 0 0\n")
    (tmp_path / "my box.mtl").write_text(
        "newmtl a\nmap_Kd -s 1 1 1 skin.png\nnewmtl b\nmap_Kd gone.png\n"
    )
    (tmp_path / "skin.png").write_bytes(b"png")
    (tmp_path / "other.png").write_bytes(b"png")
    sent = pack_files([tmp_path / "box.obj"], [])
    assert {file.path.name for file in sent.files} == {"box.obj", "my box.mtl", "skin.png"}


def test_programs_stay_programs(tmp_path: Path) -> None:
    program = tmp_path / "program"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    unpack_files(pack_files([program], []), tmp_path / "there")
    assert place_beneath(tmp_path / "there", program).stat().st_mode & 0o111
