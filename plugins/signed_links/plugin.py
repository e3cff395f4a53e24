"""What the plugin signed_links adds."""

from wil_campaign.hooks import LinkLayerKind, implements


@implements
def link_layers() -> tuple[LinkLayerKind, ...]:
    """Return what signs the frames of a vehicle with `signing`."""
    return (LinkLayerKind("signing", "wil_campaign.plugins.signed_links.signed_link:Signing"),)
