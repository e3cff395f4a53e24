"""The firmware that `accept` requires: a version, a part of one, or a git hash."""

import pytest

from wil_campaign.campaigns.values.wanted_firmware import (
    check_firmware_version,
    fits_firmware,
    names_versions,
)

HASH = "83c4f4e580000000"


@pytest.mark.parametrize(
    ("wanted", "version", "is_met"),
    [
        ("4.6", "4.6.1", True),
        ("4.6", "4.6.1-dev", True),
        ("4", "4.6.1", True),
        ("4.6.1", "4.6.1", True),
        ("4.6.1", "4.6.1-dev", False),
        ("4.6.1-dev", "4.6.1-dev", True),
        ("4.6", "4.60.1", False),
        ("4.6.1", "4.6.10", False),
        ("83c4f4e", "1.18.0-beta", True),
        ("83c4f4f", "1.18.0-beta", False),
    ],
)
def test_a_version_fits_a_wanted_one_by_its_leading_parts(
    wanted: str, version: str, is_met: bool
) -> None:
    check_firmware_version(wanted)
    assert fits_firmware(wanted, version, HASH) is is_met


@pytest.mark.parametrize("text", ["", "latest", "v1.16", "1.2.3.4", "83c4f", "4.6.*"])
def test_a_text_that_is_no_version_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="must be a version like"):
        check_firmware_version(text)


def test_shares_under_the_key_are_a_case_of_that_name() -> None:
    assert names_versions({"real": "1.16"})
    assert not names_versions({"real": "5/5"})
    assert not names_versions({"real": "decided"})
    assert not names_versions({})
