"""Inference about the arm from runs: effects are searched (`diagnose`), given (`calibrate`), or none (`compare`).

Repeated runs become blocks, and candidate effects become columns in addition to the background. Effects are selected by
evidence, refined on the simulator, and validated on independent data. docs/architecture.md shows the chain.
"""
