"""Renders the reading model to HTML, with plots and maps as SVG; pure."""
