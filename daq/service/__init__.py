"""The daemon as a service: its command, control socket and client, metrics, journal and maintenance."""
