"""Recording of runs: writes timestamped samples, and decides who may start and stop a run."""
