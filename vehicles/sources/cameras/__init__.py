"""Live and recorded cameras: images from devices, streams and files."""
