"""The device as a service: the unit for systemd, and what is said to it."""
