"""The built-in steps; wil_campaign.core_plugin lists them."""
