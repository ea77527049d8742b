"""The diagnosis: where simulation and measurement disagree, and which effect is missing.

runs → a look at them (set-ups, blocks of whitened residuals, candidates and their responses, names by evidence,
defended on the simulator) → verdict → proof on other runs; and before any run, the plan: what tests could tell at all
"""
