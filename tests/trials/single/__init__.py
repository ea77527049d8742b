"""The trial of single effects that yaw hardly separates, and of the shipped example."""
