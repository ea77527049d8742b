"""What `rig window` serves: the live cell, its session and its runs as pages, by a process that is a client of rigd."""
