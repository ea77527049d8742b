"""Apply a function to many runs: in this process, in several processes, or on a cluster. A failure affects a single
run."""
