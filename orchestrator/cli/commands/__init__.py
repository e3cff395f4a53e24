"""The commands of `wil-campaign`, one module each."""
