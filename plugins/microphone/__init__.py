"""Microphones: their model, what joins their blocks in a mixture, and steps for sound."""
