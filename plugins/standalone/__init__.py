"""An embedded vehicle that flies alone, for other programs, with a camera if wanted."""
