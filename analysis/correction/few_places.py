"""Uncertainty of a calibration by few places.

A diagnosis multiplies the uncertainty of a calibrated model by the ratio of the errors to the stated uncertainty in
neighbourhoods of places that are left out in turn. Few neighbourhoods can agree with the model by chance: of 31 tables
of 20 to 35 poses of measured arms, the ratio was 1 in 17, and there only 90 % of the errors elsewhere were within 2 u,
down to 57 % (docs/evidence/world.md). Their number gives the degrees of freedom of the ratio, so 2 u is widened by
Student's t to contain 95.45 % (GUM, Annex G.3).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.evidence.setups import GROUPS, neighbourhoods
from analysis.procedures.facts import facts_of
from analysis.runs.loading import Measured
from rigs.calibration import CalibratedModel, limited_root, packed_factor

_WITHIN = 0.9545
"""Probability of a normal error within two standard uncertainties."""
_LEAST_FREEDOM = 3
"""Chosen: under 20 places, the uncertainty is mostly that of the typical sizes that the model begins with."""


def widened_for_few_places(calibrated: CalibratedModel, runs: Sequence[Measured]) -> CalibratedModel:
    """The model with an uncertainty that its number of places supports; unchanged for other tests than poses and
    touches, and from 20 neighbourhoods on, where Student's t adds less than 7 %.
    """
    from scipy.stats import t as student  # noqa: PLC0415 - slow to import

    if not all(facts_of(run.table.test).of_places for run in runs):
        return calibrated
    count = sum(int(neighbourhoods(run.table.q, np.random.default_rng(0)).max()) + 1 for run in runs)
    if count >= GROUPS:
        return calibrated
    least = float(student.ppf((1 + _WITHIN) / 2, max(count - 1, _LEAST_FREEDOM))) / 2
    if calibrated.widened >= least:
        return calibrated
    root = limited_root(calibrated.root * least / calibrated.widened, calibrated.terms, calibrated.parameters)
    fields = {name: getattr(calibrated, name) for name in CalibratedModel.model_fields}
    # A copy would keep the cached root.
    return CalibratedModel.model_construct(**fields | {"widened": least, "factor": packed_factor(root)})
