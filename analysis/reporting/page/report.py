"""All that the page is made of, gathered once: results, measured beside simulated, and the diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from analysis.api import Compared, Diagnosis, Result, RigError, diagnose
from analysis.inference.compare import compare
from analysis.reporting.extended_rig import calibration_file
from analysis.reporting.page.before_after import BeforeAfter
from rigs.errors import FileError
from rigs.rig import Rig


@dataclass(frozen=True)
class Report:
    """Runs of one robot, evaluated. rig: the model and the limits; simulated: the runs beside the model; corrected:
    beside the model with all parts that were found, None where there are none; undiagnosed: why there is no diagnosis;
    left_out: the errors of runs that could not be evaluated."""

    rig: Rig
    results: tuple[Result, ...]
    simulated: Compared | None
    corrected: Compared | None
    found: Diagnosis | None
    undiagnosed: str
    left_out: tuple[str, ...]
    after: BeforeAfter | None = None
    """What a correction did, measured on the robot."""

    @property
    def title(self) -> str:
        """The robot that was measured: the name of its rig, which no other robot has, and its type."""
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
    """Compare and diagnose runs that were evaluated. found: a diagnosis made already; diagnosed: whether to make one;
    left_out: why other runs could not be evaluated; after: what a correction did.

    Runs that cannot be compared or diagnosed are reported all the same, with the reason. Raises FileError for runs of
    several robots.
    """
    runs = [result.measured for result in results]
    model = rig if rig is not None else runs[0].rig
    # Two robots of one type differ in the names of their rigs; the model may have a rig file of its own
    for run in runs:
        if run.rig.robot.name != model.robot.name:
            problem = f"is of {run.rig.robot.name}, and the report is about {model.robot.name}"
            raise FileError(str(run.path), problem, "make a report for each robot")
        if run.rig.name != runs[0].rig.name:
            problem = f"is of rig {run.rig.name}, and the report is about rig {runs[0].rig.name}"
            raise FileError(str(run.path), problem, "make a report for each robot")
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
    """The runs beside a model; None where it cannot be simulated beside them, as of poses."""
    runs = [result.measured for result in results if result.measured.table.kind.gauges]
    try:
        return compare(runs, rig) if runs else None
    except RigError:
        return None
