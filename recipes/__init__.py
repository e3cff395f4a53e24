"""Recipes: how the readings of two worlds become one (transform, filter, merge, publish). Pure."""

if __name__ == "recipes":
    raise ImportError("import wil_campaign.recipes, not recipes: a module has one name")
