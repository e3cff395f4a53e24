"""Draws the reading model: templates, plots and maps as SVG; pure."""
