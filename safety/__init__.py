"""Safety: oracles that judge, the geofence, contingency actions and the guard."""
