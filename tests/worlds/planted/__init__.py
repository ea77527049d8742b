"""Simulated cases with known results: every figure is measured in noise and compared with its exact value.

`closed_forms` contains the formulas, `cells` the noise of a cell, `circles`, `targets` and `poses` the tests, and
`score` the agreement of figures with the truth.
"""
