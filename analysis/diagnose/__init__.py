"""The diagnosis: where simulation and measurement disagree, and which effect is missing.

runs → blocks (whitened residuals) → candidates and their responses → search by evidence, with refined shapes

The engine only; verdicts, the proof on other places and the command are to be built on it.
"""
