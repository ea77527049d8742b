"""How noisy readings are: found from what a measurement repeats, assumed wide where it repeats nothing."""
