"""The better posture: expected errors of all postures that reach a target, their best sequence, and a map of places."""
