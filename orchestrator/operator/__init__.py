"""Where operators' commands come in and what flies is told to them: sockets, MQTT, one desk."""
