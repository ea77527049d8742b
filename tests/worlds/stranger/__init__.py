"""Independently generated measurements: cases with hidden effects for the blind trial of `rig diagnose`.

This package shares no code with rig. It uses only numpy, yaml and the standard library. Kinematics are a product of
exponentials. Every effect is implemented again from the page on measurements and the vocabulary, and then perturbed, as
in nature. `generate_real` writes the files of a measurement (CSV tables, rig files) and stores the truth in a different
place.
"""

from tests.worlds.stranger.real.cases import REAL_KINDS, generate_real

__all__ = ["REAL_KINDS", "generate_real"]
