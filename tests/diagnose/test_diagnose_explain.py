"""Names refined once are not refined again, and never taken for others."""

from __future__ import annotations

from cells import healthy

from analysis.diagnose.candidates import candidates_for
from analysis.diagnose.evidence import Dictionary
from analysis.diagnose.explain import Explainer
from analysis.diagnose.search import Search
from rigs.effects import BallForm


def test_five_lobes_after_three_are_five() -> None:
    linear = healthy()
    explainer = Explainer(linear, Search(Dictionary(linear, candidates_for(linear))))
    for lobes in (3, 5, 3):
        (effect,) = explainer._refined([BallForm(lobes=lobes, amplitude_mm=0.001)]).effects
        assert effect.lobes == lobes
    first = explainer._refined([BallForm(lobes=3, amplitude_mm=0.001)])
    assert explainer._refined([BallForm(lobes=3, amplitude_mm=0.002, phase_deg=40.0)]) is first
