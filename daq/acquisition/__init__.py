"""From the links to stamped samples: a reader thread for each stream, its buffer, and checks of readings and clocks."""
