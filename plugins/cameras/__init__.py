"""Live cameras and recorded images."""
