"""Independently generated measurements: cases with hidden effects for the blind trial of `rig diagnose`.

This package shares no code with rig. It uses only numpy, yaml and the standard library. Kinematics are a product of
exponentials. Every effect is implemented again from the page on measurements and the vocabulary, and then perturbed, as
in nature. `generate` writes the files of a measurement (CSV tables, rig files) and stores the truth in a different
place.
"""

from tests.worlds.stranger.cases import KINDS, SCALES, energy_of, generate
from tests.worlds.stranger.real.cases import RATES_HZ, REAL_KINDS, generate_real
from tests.worlds.stranger.real.gap import gap_of_real

__all__ = ["KINDS", "RATES_HZ", "REAL_KINDS", "SCALES", "energy_of", "gap_of_real", "generate", "generate_real"]
