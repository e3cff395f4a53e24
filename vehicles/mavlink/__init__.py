"""MAVLink frames and messages: framing, packing, signing, and names of enum values."""
