"""The embedded vehicle: JSBSim quadrotor, sensors, estimator, and an autopilot that speaks MAVLink."""

from vehicles.embedded.airframe import Airframe
from vehicles.embedded.config import EmbeddedConfig, HearsEvents, Surroundings
from vehicles.embedded.profile import Profile, ProfileError, list_profiles, load_profile
from vehicles.embedded.states import TruthSample
from vehicles.embedded.vehicle import EmbeddedVehicle

__all__ = [
    "Airframe",
    "EmbeddedConfig",
    "EmbeddedVehicle",
    "HearsEvents",
    "Profile",
    "ProfileError",
    "Surroundings",
    "TruthSample",
    "list_profiles",
    "load_profile",
]
