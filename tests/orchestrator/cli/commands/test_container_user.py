"""A flight as in `docker run -u 12345`: a user that nobody knows, without a home, who may write to
TMPDIR alone."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests import kernels
from tests.orchestrator.hover import write_hover
from wil_campaign.worlds import jit

_ROOT = Path(__file__).parents[4]
_UID = 12345
_CAMERA = """\
  twin:
    link: embedded
    autopilot: px4
    sensors: {camera: {type: camera, rate_hz: 5, width_px: 32, height_px: 24, fov_deg: 69}}
"""
_KERNELS = (
    "worlds/render",
    "worlds/clearance",
    "vehicles/perception",
    "vehicles/embedded/control",
    "vehicles/embedded/physics",
    "plugins/ardupilot/copter",
)
"""The packages with kernels that a flight uses."""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can fly as another user")
def test_an_unknown_user_without_a_home_flies_from_a_read_only_installation(
    short_folder: Path,
) -> None:
    """TMPDIR is too long for the paths of sockets; the kernels are compiled already."""
    short_folder.chmod(0o755)
    temporary, home = short_folder / ("x" * 90), short_folder / "campaign"
    for folder in (temporary, home):
        folder.mkdir()
    campaign = write_hover(home)
    text = campaign.read_text().replace("{twin: {link: embedded, autopilot: px4}}", "\n" + _CAMERA)
    campaign.write_text(text.replace("repetitions: 2", "repetitions: 1"))
    kernels.main()
    for package in _KERNELS:
        cached = jit.cache_folder(Path(jit.__file__).parents[1] / package)
        assert cached is not None
        name = cached.name.removeprefix(f"wil-{os.getuid()}-")
        shutil.copytree(cached, temporary / f"wil-{_UID}-{name}")
    for one in (temporary, home, *temporary.rglob("*"), *home.rglob("*")):
        os.chown(one, _UID, _UID)

    def call(*command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(  # noqa: S603 - our own program
            [sys.executable, "-P", *command],
            user=_UID,
            group=_UID,
            extra_groups=[],
            env={"PATH": os.environ["PATH"], "PYTHONPATH": str(_ROOT), "TMPDIR": str(temporary)},
            cwd=home,
            capture_output=True,
            text=True,
            check=False,
        )

    if call("-c", "import wil_campaign, numpy").returncode:
        pytest.skip("another user may not read this checkout, or its environment")
    flown = call("-m", "wil_campaign", "run", campaign.name, "--out", "results")
    assert flown.returncode == 0, flown.stdout + flown.stderr
    assert list(home.glob("results/hover/*/*/sim/1/result.json"))
    assert len(list(temporary.glob("wil-*-kernels-*"))) == len(_KERNELS), "it compiled others"
