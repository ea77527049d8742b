"""The diagnosis finds where simulation and measurement disagree, and which effect the model lacks.

runs → search (set-ups, blocks of whitened residuals, candidate effects and their responses, selection by evidence,
comparison with rivals on the simulator) → verdict → validation on other runs. Before any run, the plan predicts which
effects a set of tests can detect and distinguish.
"""
