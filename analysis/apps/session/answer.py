"""Diagnosis of the runs of a session in a separate process."""

from __future__ import annotations

import ctypes
import multiprocessing as mp
import os
import signal
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.apps.session.session_state import Answer, PartOfError, SessionAct
from analysis.diagnosis.judge.acts import acts_with
from analysis.runs.loading import load_measured
from rigs.calibration import ground_of
from rigs.errors import CellError, RigError
from rigs.text import as_argument

if TYPE_CHECKING:
    from analysis.diagnosis.judge.result import Diagnosis

_SHOWN = 6
"""Number of parts of the error listed by a session. The page lists all of them."""
_NICE = 5
"""Niceness of the inference process: the readers of gauges and robot have priority."""
_PR_SET_PDEATHSIG = 1
"""Request of prctl(2): a signal at the death of the parent (linux/prctl.h)."""


def infer(used: Sequence[Path], judges: Sequence[Path], rig_file: Path, directory: Path) -> tuple[Answer, Diagnosis]:
    """Diagnose runs with a rig file, and write the files of the diagnosis to a directory. judges: unseen runs of the
    other place.
    """
    import analysis  # noqa: PLC0415 - slow to import, needed in the process of an inference only
    from analysis.apps.report.act_words import ActWords, command  # noqa: PLC0415
    from analysis.apps.report.answer_words import part_of  # noqa: PLC0415
    from analysis.apps.report.diagnosis_report import write  # noqa: PLC0415
    from analysis.apps.report.diagnosis_words import measured_u  # noqa: PLC0415
    from analysis.apps.report.summary_words import summarise  # noqa: PLC0415
    from analysis.cli.several import with_recorded_controller  # noqa: PLC0415
    from analysis.diagnosis.plan.plan_next import JOINED  # noqa: PLC0415
    from rigs.load import load  # noqa: PLC0415

    runs, elsewhere = ([load_measured(path) for path in paths] for paths in (used, judges))
    rig, text = with_recorded_controller(*load(rig_file), runs)
    diagnosis = analysis.diagnose(runs, rig=rig, unseen=elsewhere)
    written = write(diagnosis, text, directory, in_session=True)
    model = next((path for path in written if path.suffix == ".yaml"), None)
    named = replace(diagnosis, acts=acts_with(diagnosis.acts, as_argument(model or directory)))
    words, summary = ActWords(named), summarise(named)
    error, accuracy = summary.error, diagnosis.accuracy
    faults = [part_of(diagnosis, entry) for entry in diagnosis.standing]
    acts = tuple(
        SessionAct(
            kind=act.kind, why=act.why, words=words.sentence(act), corrected=words.sentence(act, corrected=True),
            step=words.imperative(act), action=words.action_of(act), command=command(act),
            remains_um=act.remains_um, with_before_um=act.with_before_um,
        )
        for act in named.acts
    )  # fmt: skip
    parts = tuple(
        PartOfError(
            part=words.short_name(entry), kind=entry.kind, size=words.size_of(entry), share=round(entry.share, 4),
            um=round(entry.um, 2), fault=entry in faults,
        )
        for entry in diagnosis.budget[:_SHOWN]
    )  # fmt: skip
    tests = [act.test.test for act in diagnosis.acts if act.test and act.test.test != JOINED]
    tests += [diagnosis.next_test.test] if diagnosis.next_test else []
    answer = Answer(
        runs=len(used), judges=len(judges), condition=diagnosis.condition, standing=accuracy.standing,
        headline=f"{summary.badge}: {summary.headline}",
        accuracy=f"{words.accuracy} {error.title}: {error.words}. {error.basis} {error.standing}",
        next_step=words.next, parts=parts, remedies=tuple(act.words for act in acts[1:]), acts=acts,
        next_test=tests[0] if tests else "", runs_to_decide=diagnosis.runs_to_decide,
        ground=ground_of(diagnosis.calibrated) if diagnosis.calibrated else "",
        now_um=accuracy.now_um, calibrated_um=accuracy.calibrated_um, before_there_um=accuracy.before_there_um,
        level=diagnosis.levels["others"], noise_um=measured_u(diagnosis, diagnosis.train.noise_floor_um),
        seconds=round(diagnosis.seconds, 1), found=directory.name, model=model.name if model else "", summary=summary,
    )  # fmt: skip
    return answer, diagnosis


class Inference:
    """An inference in a separate process, which ends with this one."""

    def __init__(self, used: Sequence[Path], judges: Sequence[Path], rig_file: Path, directory: Path) -> None:
        context = mp.get_context("spawn")
        self._outcome, returned = context.Pipe(duplex=False)
        request = (returned, used, judges, rig_file, directory)
        self._process = context.Process(target=_infer_and_return, args=request, daemon=True)
        self._process.start()
        returned.close()

    @property
    def is_done(self) -> bool:
        return self._outcome.poll() or not self._process.is_alive()

    def result(self) -> tuple[Answer, Diagnosis]:
        """Raises RigError if the diagnosis failed."""
        try:
            outcome: tuple[Answer, Diagnosis] | RigError = self._outcome.recv()
        except (EOFError, OSError):  # killed before or while it returned the outcome
            problem, remedy = "exited unexpectedly", "close other programs, then repeat the command"
            raise CellError("inference", problem, remedy, code="process.failed") from None
        if isinstance(outcome, RigError):
            raise outcome
        return outcome


def _infer_and_return(
    returned: Connection, used: Sequence[Path], judges: Sequence[Path], rig_file: Path, directory: Path
) -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(_NICE)
    try:
        returned.send(infer(used, judges, rig_file, directory))
    except RigError as error:
        returned.send(error)
