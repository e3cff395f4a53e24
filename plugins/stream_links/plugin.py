"""What the plugin stream_links adds."""

from wil_campaign.hooks import LinkKind, implements


@implements
def links() -> tuple[LinkKind, ...]:
    """Return links by TCP and by serial ports."""
    return (
        LinkKind("tcpin", "socket", "wil_campaign.plugins.stream_links.tcp:tcp_server"),
        LinkKind("tcpout", "socket", "wil_campaign.plugins.stream_links.tcp:tcp_client"),
        LinkKind("serial", "device", "wil_campaign.plugins.stream_links.serial:serial_link"),
    )
