"""The HSV test of pixels: its Python function and the compiled one mark the same pixels."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from wil_campaign.vehicles.perception.hsv import NAMED_COLORS, HsvMask


@pytest.mark.parametrize("color", sorted(NAMED_COLORS))
def test_a_small_image_is_masked_as_a_part_of_a_large_one(color: str) -> None:
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (96, 64, 3), np.uint8)
    image[:8] = image[:8] // 32 * 32  # many at the limits, and grey ones
    image[8:16] = image[8:16, :, :1]
    whole = HsvMask(NAMED_COLORS[color]).of(image).copy()
    small = HsvMask(NAMED_COLORS[color])
    for row in range(0, 96, 8):
        for column in range(0, 64, 8):
            part = np.s_[row : row + 8, column : column + 8]
            assert np.array_equal(small.of(image[part].copy()), whole[part])


def test_a_campaign_is_validated_without_numba() -> None:
    # To import it and load a kernel is a quarter of what `validate` takes.
    program = (
        "import sys; from wil_campaign.orchestrator.cli import main;"
        " code = main(['validate', sys.argv[1]]); assert 'numba' not in sys.modules; sys.exit(code)"
    )
    campaign = Path(__file__).parents[3] / "campaigns" / "gate.yaml"
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", program, campaign], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
