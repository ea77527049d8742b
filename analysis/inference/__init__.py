"""Inference: what runs say about the arm. Names are searched (`diagnose`), given (`calibrate`) or none (`compare`).

Runs become observations and then blocks; candidates become columns beside the background; names are selected by
evidence, refined on the simulator, and judged on what had no part in it.
"""
