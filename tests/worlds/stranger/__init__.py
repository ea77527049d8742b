"""Measurements by a stranger: cases of hidden effects for the blind trial of `rig diagnose`.

Shares no code with the project: numpy, yaml and the standard library only. Kinematics are a product of exponentials,
every effect is written anew from the page of measurements and the vocabulary, and then perturbed, as nature does.
`generate` writes what a stranger would send (CSV tables, rig files) and seals the truth elsewhere.
"""

from tests.worlds.stranger.cases import KINDS, SCALES, energy_of, gap_of, generate, left_of
from tests.worlds.stranger.real.cases import RATES_HZ, REAL_KINDS, generate_real
from tests.worlds.stranger.real.gap import gap_of_real

__all__ = [
    "KINDS", "RATES_HZ", "REAL_KINDS", "SCALES", "energy_of", "gap_of", "gap_of_real", "generate",
    "generate_real", "left_of",
]  # fmt: skip
