"""Apply a function to many runs: in this process, in several, or on a cluster; a failure affects only one run."""
