"""Pictures of scenes: colour, depth and object ids from an exact pinhole, on the CPU."""
