"""Link strings: one syntax, and suggestions for others."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link_strings import LinkAddress, LinkAddressError, parse_link


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("udpin://10.0.0.1:14540", LinkAddress("udpin", host="10.0.0.1", port=14540)),
        ("udpout://drone-7.local:14550", LinkAddress("udpout", host="drone-7.local", port=14550)),
        ("udpin://[::1]:14540", LinkAddress("udpin", host="::1", port=14540)),
        ("tcpout://127.0.0.1:5760", LinkAddress("tcpout", host="127.0.0.1", port=5760)),
        ("tcpin://10.0.0.1:5760", LinkAddress("tcpin", host="10.0.0.1", port=5760)),
        (
            "serial:///dev/ttyACM0:921600",
            LinkAddress("serial", device="/dev/ttyACM0", baud=921600),
        ),
        (
            "serial:///dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0:57600",
            LinkAddress(
                "serial", device="/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0", baud=57600
            ),
        ),
        ("memory://", LinkAddress("memory")),
    ],
)
def test_reads_and_writes_the_syntax(text: str, address: LinkAddress) -> None:
    assert parse_link(text) == address
    assert str(address) == text


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("udp:127.0.0.1:14540", "udpin://127.0.0.1:14540"),
        ("udp://:14540", "udpin://0.0.0.0:14540"),
        ("udpin:0.0.0.0:14550", "udpin://0.0.0.0:14550"),
        ("udpout:10.0.0.2:14550", "udpout://10.0.0.2:14550"),
        ("tcp:127.0.0.1:5760", "tcpout://127.0.0.1:5760"),
        ("tcp://127.0.0.1:5760", "tcpout://127.0.0.1:5760"),
        ("/dev/ttyACM0", "serial:///dev/ttyACM0:57600"),
        ("/dev/ttyUSB0,921600", "serial:///dev/ttyUSB0:921600"),
        ("serial:/dev/ttyUSB0:921600", "serial:///dev/ttyUSB0:921600"),
        ("serial:///dev/ttyUSB0", "serial:///dev/ttyUSB0:57600"),
        ("COM3:115200", "serial://COM3:115200"),
        ("updin://0.0.0.0:14540", "udpin://0.0.0.0:14540"),
        ("UDPOUT://10.0.0.2:14550", "udpout://10.0.0.2:14550"),
    ],
)
def test_suggests_what_was_meant(text: str, meant: str) -> None:
    with pytest.raises(LinkAddressError) as caught:
        parse_link(text)
    assert f"did you mean {meant}?" in str(caught.value)
    assert str(parse_link(meant)) == meant


@pytest.mark.parametrize(
    "text",
    ["", "14540", "udpin://", "udpin://host", "udpin://host:0", "udpin://host:70000",
     "udpin://a b:14540", "serial:///dev/ttyACM0:9", "http://x:1/2", "udp:127.0.0.1:99999"],
)  # fmt: skip
def test_refuses_and_shows_the_text(text: str) -> None:
    with pytest.raises(LinkAddressError) as caught:
        parse_link(text)
    assert repr(text) in str(caught.value)
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, VehicleError)


@given(st.text(max_size=40))
def test_never_raises_anything_else(text: str) -> None:
    try:
        address = parse_link(text)
    except LinkAddressError as error:
        suggested = str(error).partition("did you mean ")[2].removesuffix("?")
        if suggested:
            parse_link(suggested)
    else:
        assert parse_link(str(address)) == address
