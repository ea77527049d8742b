"""Web server of `rig window`: live cell, session and runs as pages, in a process that is a client of rigd."""
