"""The plugins that ship with the program: what a campaign can do without; the core imports none."""

if __name__ == "plugins":
    raise ImportError("import wil_campaign.plugins, not plugins: a module has one name")
