"""Apply a function to many runs: here, in several processes, or on a cluster. A failure affects a single run."""
