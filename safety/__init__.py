"""Safety: oracles that judge, the geofence, contingency actions and the guard."""

if __name__ == "safety":
    raise ImportError("import wil_campaign.safety, not safety: a module has one name")
