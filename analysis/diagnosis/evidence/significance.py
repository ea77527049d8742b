"""Thresholds of significance, common to all stages of a diagnosis."""

ODDS = 20.0
"""Odds at which a rival is dismissed, 20 to 1: the usual 5 % level. A named effect with a closer rival is ambiguous."""
POSSIBLE_SIGMA = 2.0
"""Standard uncertainties from which a contribution is known at all: below, it may be absent."""
SURE_SIGMA = 3.0
"""Standard uncertainties from which an effect with no rival is certain: odds of 400 to 1."""
CERTAIN_SIGMA = 7.0
"""Standard uncertainties from which an effect is detected among some hundred forms: a log evidence of 24.5, well above
the price of the choice.
"""
