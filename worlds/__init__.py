"""World models: frames, scenes, rendering, lidar, clearance; imports no other package."""

if __name__ == "worlds":
    raise ImportError("import wil_campaign.worlds, not worlds: a module has one name")
