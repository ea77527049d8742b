"""Recording: turns stamped samples into runs, and decides who may start and stop a run."""
