"""A daemon and a cell in simulated time, in one process: hours pass as fast as they are computed."""
