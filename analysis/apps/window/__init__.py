"""Web server of `rig window`: pages for the live cell, the session and the runs, in a client process of rigd."""
