"""What the plugin paper_xml adds."""

from wil_campaign.hooks import RecipeFormat, implements


@implements
def recipe_formats() -> tuple[RecipeFormat, ...]:
    """Return the XML form of the paper."""
    return (RecipeFormat(".xml", "wil_campaign.plugins.paper_xml.paper_xml:parse_paper_xml"),)
