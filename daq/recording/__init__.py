"""From stamped samples to a run: the recorder, the runs it begins and ends, and who may start and stop it."""
