"""Fifth stage of a diagnosis: the calibrated model, the residual as its parts are added, and the doubts."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from analysis.diagnosis.evidence.gather import Evidence
from analysis.diagnosis.fit.fit_evidence import Fit
from analysis.diagnosis.judge.calibrated_model import calibrated_model
from analysis.diagnosis.judge.disagreement import staircase_of
from analysis.diagnosis.judge.doubts import doubts_of_rig, doubts_of_runs
from analysis.diagnosis.judge.judge import Findings
from analysis.diagnosis.judge.misses import remains_of
from analysis.diagnosis.judge.result import Diagnosis, Verdict
from analysis.diagnosis.judge.validate import Validation
from analysis.diagnosis.judge.verdict import judged_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import Measured
from rigs.load import contradictions


def conclude(evidence: Evidence, fit: Fit, validation: Validation, verdict: Verdict, findings: Findings) -> Diagnosis:
    """Return the diagnosis of a verdict, before its actions; readings are (m, k) mm."""
    result, used, stages = fit.result, evidence.uses.used, validation.stages
    sound, judges, elsewhere = validation.sound, validation.judges, validation.elsewhere
    wider = validation.widening
    judged = judged_of(verdict, validation.whole, validation.gaps, wider.unexplained_mm)
    calibrated = (
        None if fit.out_of_range else calibrated_model(verdict, result, used, evidence.runs, stages, wider, judged)
    )
    remains = remains_of(result, validation.left_out, temperature_of(used))
    staircase = staircase_of(verdict, result, stages, sound, judges, elsewhere)
    doubts = [*evidence.doubts, *findings.early, *validation.doubts, *findings.at_limits]
    if calibrated is not None and (why := next(contradictions(calibrated, evidence.rig), "")):
        calibrated = None
        doubts.append(f"no calibrated model is written, because it {why}; measure again, with more postures")
    doubts += [*doubts_of_runs(result.linear.blocks), *doubts_of_rig(evidence.rig, validation.fitted)]
    return Diagnosis(
        **{field.name: getattr(verdict, field.name) for field in fields(verdict)},
        next_test=None,
        doubts=tuple(doubts),
        seconds=0.0,
        calibrated=calibrated,
        staircase=staircase,
        remains=remains,
        only_commanded=any(run.has_only_commanded_angles for run in used),
    )


_TEMPERATURE = re.compile(r"(?<![a-z])temp(erature)?(?![a-z])")


def temperature_of(used: Sequence[Measured]) -> Array | None:
    """Return the temperature (n,) of each table row; None for several runs or if unknown.

    It is an extra column identified by its name, in any unit.
    """
    table = used[0].run.table if len(used) == 1 else None
    if table is None:
        return None
    for name in table.column_names:
        if _TEMPERATURE.search(name.casefold()):
            try:
                values = np.array([float(str(cell).replace(",", ".")) for cell in table[name].to_pylist()])
            except ValueError:
                continue
            return values if len(values) == len(used[0].table.q) and np.isfinite(values).all() else None
    return None
