"""Links by streams of bytes, which are lost and opened again: TCP, and serial ports."""
