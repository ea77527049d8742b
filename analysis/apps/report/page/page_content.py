"""Contents of the page: results, comparison with simulation, diagnosis and effect of a correction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from analysis.api import Compared, Diagnosis, Result, RigError, diagnose
from analysis.apps.report.diagnosis_report import calibration_file
from analysis.apps.report.page.before_after import BeforeAfter
from analysis.diagnosis.judge.compare_runs import compare
from analysis.runs.tables import format_of
from rigs.errors import FileError
from rigs.rig import Rig


@dataclass(frozen=True)
class Report:
    """rig: model and limits. corrected: runs compared with the model and the found parts. undiagnosed: reason for a
    missing diagnosis. left_out: errors of runs that could not be evaluated.
    """

    rig: Rig
    results: tuple[Result, ...]
    simulated: Compared | None
    corrected: Compared | None
    found: Diagnosis | None
    undiagnosed: str
    left_out: tuple[str, ...]
    after: BeforeAfter | None = None
    """Measured effect of a correction."""

    @property
    def title(self) -> str:
        return f"{self.results[0].measured.rig.name} – {self.rig.robot.name}"


def gather(
    results: Sequence[Result],
    rig: Rig | None = None,
    *,
    diagnosed: bool = True,
    diagnosis: Diagnosis | None = None,
    left_out: Sequence[RigError] = (),
    after: BeforeAfter | None = None,
    progress: Callable[[str], None],
) -> Report:
    """Compare and diagnose evaluated runs, or state why this is impossible.

    diagnosis: an existing one; diagnosed: whether to make one. Raises FileError for runs of several robots.
    """
    runs = [result.measured for result in results]
    model = rig if rig is not None else runs[0].rig
    # Two robots of one type differ in rig names; the model may come from a separate rig file
    for run in runs:
        if (run.rig.robot.name, run.rig.name) != (model.robot.name, runs[0].rig.name):
            about = f"the report is about rig {runs[0].rig.name} of {model.robot.name}"
            problem = f"is of rig {run.rig.name} of {run.rig.robot.name}, but {about}"
            raise FileError(str(run.path), problem, "make a report for each robot", code="report.other_robot")
    undiagnosed = ""
    if diagnosis is None and diagnosed:
        try:
            diagnosis = diagnose(runs, rig=model, progress=progress)
        except RigError as error:
            undiagnosed = str(error)
    progress("simulating the runs")
    simulated, corrected = _compared(results, model), None
    if diagnosis is not None and diagnosis.calibrated is not None:
        with_findings = diagnosis.extended_rig.with_calibration(
            calibration_file("found.calibration.json", diagnosis.calibrated.content), diagnosis.calibrated
        )
        corrected = _compared(results, with_findings)
    return Report(model, tuple(results), simulated, corrected, diagnosis, undiagnosed, tuple(map(str, left_out)), after)


def _compared(results: Sequence[Result], rig: Rig) -> Compared | None:
    """None if the runs cannot be simulated, such as poses."""
    runs = [result.measured for result in results if format_of(result.measured.table.test).gauges]
    try:
        return compare(runs, rig) if runs else None
    except RigError:
        return None
