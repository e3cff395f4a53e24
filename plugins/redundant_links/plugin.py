"""What the plugin redundant_links adds."""

from wil_campaign.hooks import LinkLayerKind, implements


@implements
def link_layers() -> tuple[LinkLayerKind, ...]:
    """Return what joins the links of a vehicle with `spare_links`."""
    return (
        LinkLayerKind("spare_links", "wil_campaign.plugins.redundant_links.redundant:Redundancy"),
    )
