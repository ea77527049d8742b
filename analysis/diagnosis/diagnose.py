"""Diagnosis of runs: find the disagreement, identify the missing effects, validate them, and state the doubts.

runs → evidence → effects selected and refined on the simulator → gaps of the model → diagnosis → actions
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from analysis.diagnosis.evidence.gather import gather
from analysis.diagnosis.fit.contradictions import without_contradicted
from analysis.diagnosis.fit.fit_evidence import fit_evidence
from analysis.diagnosis.judge.judge import judge
from analysis.diagnosis.judge.result import Diagnosis
from analysis.diagnosis.judge.validate import validate
from analysis.diagnosis.plan.plan_next import plan_next
from analysis.runs.loading import Measured
from rigs.effects import Effect
from rigs.rig import Rig


def diagnose(
    rig: Rig,
    used: Sequence[Measured],
    held_out: Sequence[Measured],
    unseen: Sequence[Measured],
    progress: Callable[[str], None],
    tolerance_um: float | None = None,
    given: Sequence[Effect] | None = None,
) -> Diagnosis:
    """Diagnose runs of one robot with the model of a rig, validated on held-out runs and unseen places.

    `tolerance_um`: largest accepted rms error of the readings; by default the limits of the rig file decide. `given`:
    effects to be fitted regardless of their significance, without a search. Without held-out runs, a fifth of 60 or
    more poses is held out. Raises FileError for runs of a different robot, or not readable as the stated test.

    It uses one BLAS thread: the matrices are small, and further threads only wait for each other.
    """
    begin_s = time.perf_counter()
    with threadpool_limits(limits=1, user_api="blas"):
        evidence = gather(rig, used, held_out, unseen, tolerance_um, progress)
        evidence, contradictions = without_contradicted(evidence, given, progress)
        fit = fit_evidence(evidence, given, progress)
        validation = validate(evidence, fit, progress)
        diagnosis, early = judge(evidence, fit, validation)
        diagnosis = replace(diagnosis, contradictions=contradictions)
        diagnosis = plan_next(diagnosis, evidence, fit, validation, progress, early=early)
        return replace(diagnosis, seconds=time.perf_counter() - begin_s, work=fit.result.work)
