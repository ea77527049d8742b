"""What the background is on average, as terms and as effects of the arm.

Every form of the background is its effect at the size at which its column was computed, and how many times of it the
readings show. Single forms are rarely certain, and their sum is: it is what reaches a tenth of a millimetre where named
effects reach half of one.
"""

from __future__ import annotations

from analysis.diagnosis.background import Posterior
from rigs.calibration import Term, effects_of, is_nothing
from rigs.effects import Effect


def background_terms(posterior: Posterior) -> list[Term]:
    """Return the forms of the background, each with how many times it shows on average."""
    mean, found = posterior.mean, []
    for form in posterior.background.columns.forms:
        for effect, column in zip(form.effects, form.columns, strict=True):
            times = float(mean[column] / form.size)
            # What a model leaves out is not written either, so that whoever reads the file has the same model.
            times = 0.0 if is_nothing(effect, times) else times
            found.append(Term.model_construct(effect=effect, times=times, named=False))
    return found


def background_effects(posterior: Posterior) -> tuple[Effect, ...]:
    """Return what the forms of the background are together, as effects of the arm."""
    return tuple(effects_of([(term.effect, term.times) for term in background_terms(posterior)]))
