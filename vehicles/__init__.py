"""Vehicles: readings, links, MAVLink, autopilots, drivers, the embedded vehicle, perception."""

if __name__ == "vehicles":
    raise ImportError("import wil_campaign.vehicles, not vehicles: a module has one name")
