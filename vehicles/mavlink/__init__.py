"""MAVLink on the wire: frames, messages, and the words of its numbers."""
