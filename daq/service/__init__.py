"""The daemon as a service: command, control socket, client, metrics, journal and maintenance."""
