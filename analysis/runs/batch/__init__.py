"""One function over many runs: in this process, in several, or on a cluster; a failure costs only its own run."""
