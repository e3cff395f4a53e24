"""Compares flights of one campaign with those of others."""
