"""Simulators that render a camera's images on request, by a protocol of ours."""
