"""The emulated ArduCopter."""
