"""Sources of depth images: RTP with 16 bits, and RealSense cameras by their library."""
