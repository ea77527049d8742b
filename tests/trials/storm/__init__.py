"""Faults by seed: small worlds of a cell, a daemon and a disk in simulated time, each drawn from its seed."""
