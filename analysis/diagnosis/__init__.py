"""Inference: what runs say about the arm. Names are searched (`diagnose`), given (`calibrate`) or none (`compare`).

Repeated runs become blocks; candidates become columns beside the background; names are selected by evidence, refined on
the simulator, and judged on what had no part in it: docs/architecture.md draws the chain.
"""
