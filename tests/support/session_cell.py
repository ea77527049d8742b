"""A session without hardware: its programs are simulated immediately, and the diagnoses are prepared in advance."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import analysis
from analysis.apps.report.blocks import Block
from analysis.apps.session.answer import Inference
from analysis.apps.session.cell import ProgramRun, RealCell
from analysis.apps.session.run_session import Conductor
from analysis.apps.session.session_plan import BY_ITSELF, FIXED, SessionOptions, SessionProgram, planned
from analysis.apps.session.session_state import (
    Answer,
    Emulated,
    PartOfError,
    ProgramStep,
    Session,
    SessionDirectory,
    Stage,
    digest_of,
)
from rigs.calibration import CalibratedModel, packed_factor
from rigs.errors import RigError
from rigs.load import load, parse
from rigs.schema.vocabulary import Direction
from rigs.yaml_text import data_of
from tests.support.made_once import made_once

PART = PartOfError(part="gear error of axis 4", kind="effect", share=0.98, um=50.0, fault=True)
NAMED = Answer(
    runs=0,
    condition="named",
    standing=None,
    headline="One fault was found.",
    accuracy="The error is now 50 µm rms.",
    next_step="Repair it.",
    parts=(PART,),
    now_um=50.0,
    calibrated_um=2.0,
    noise_um=2.0,
    seconds=1.0,
    found="01",
)
HIDDEN = {"effects": [{"effect": "joint_offset", "axis": 3, "offset_deg": 0.05}], "eccentricity_mm": [0.5, -0.3, 0.1]}
CORRECTED = {"effects": [{"effect": "joint_offset", "axis": 3, "offset_deg": 0.005}], "eccentricity_mm": [0.4, 0, 0.1]}


class Killed(BaseException):
    """Emulated death of the process."""


def cell_file(directory: Path) -> Path:
    """Write the rig file of a cell with short laps."""
    data = data_of(load("paper-fanuc")[1])
    data["tests"]["circle"] |= {"laps": 1, "speed_mm_s": 100.0}
    path = directory / "cell.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return path


@made_once
def _model_files() -> dict[str, bytes]:
    """Rig file and the calibration written by a diagnosis."""
    import tempfile  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        cell, hidden = cell_file(place), place / "hidden.yaml"
        hidden.write_text(yaml.safe_dump(HIDDEN))
        ways: tuple[Direction, ...] = ("acw", "cw")
        runs = [analysis.simulate(cell, "yaw", way, seed=k, effects=hidden) for k, way in enumerate(ways)]
        from analysis.apps.report.diagnosis_report import write  # noqa: PLC0415

        found = analysis.calibrate(runs, "joint_offset:3")
        assert found.calibrated is not None
        write(replace(found, calibrated=_of_few_terms(found.calibrated)), cell.read_text(), place / "found")
        return {path.name: path.read_bytes() for path in (place / "found").iterdir() if path.suffix != ".png"}


def _of_few_terms(model: CalibratedModel) -> CalibratedModel:
    """Model with its named terms and only six others.

    A correction evaluates the effect of each parameter on every pose, which takes most of the time of a session. A
    model with all terms is a nightly test.
    """
    chosen = [k for k, term in enumerate(model.terms) if term.named]
    chosen += [k for k in range(len(model.terms)) if k not in chosen][:6]
    rows = [row for row, one in enumerate(model.parameters) if one.term in chosen]
    parameters = [model.parameters[row] for row in rows]
    few = {
        "terms": [model.terms[k] for k in chosen],
        "parameters": [one.model_copy(update={"term": chosen.index(one.term)}) for one in parameters],
        "factor": packed_factor(np.linalg.qr(model.root[rows].T)[1].T),
    }
    return CalibratedModel.model_validate({name: getattr(model, name) for name in type(model).model_fields} | few)


@dataclass
class InstantDiagnosis:
    """A diagnosis that finishes immediately. kept: represents the diagnosis itself."""

    answer: Answer | RigError
    is_done: bool = True
    kept: Any = None

    def result(self) -> tuple[Answer, Any]:
        if isinstance(self.answer, RigError):
            raise self.answer
        return self.answer, self.kept


@dataclass
class Oracle:
    """Returns prepared diagnoses in turn and repeats the last one. Each writes the files of a diagnosis."""

    answers: list[Answer] = field(default_factory=lambda: [NAMED])
    asked: list[tuple[int, int]] = field(default_factory=list)

    def __call__(self, used: Sequence[Path], judges: Sequence[Path], rig_file: Path, directory: Path) -> Inference:
        self.asked.append((len(used), len(judges)))
        directory.mkdir(parents=True)
        for name, content in _model_files().items():
            (directory / name).write_bytes(content)
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        model = next(name for name in _model_files() if name.endswith(".yaml"))
        changed = {"runs": len(used), "judges": len(judges), "found": directory.name, "model": model}
        kept = [run.name for run in (*used, *judges)]
        return InstantDiagnosis(answer.model_copy(update=changed), kept=kept)  # type: ignore[return-value]  # like one


class Simulated(RealCell):
    """Simulates a run of the rig file of each step."""

    def __init__(self, directory: Path) -> None:
        self.directory, self.oracle = directory, Oracle()
        self.driven: list[str] = []
        self.stages: list[str] = []
        self.entered: list[Path] = []
        self._programs: Mapping[str, SessionProgram] = {}

    def set_up(self, stage: Stage, programs: Mapping[str, SessionProgram]) -> None:
        self.stages.append(stage.name)
        self._programs = programs

    def infer(self, used: Sequence[Path], judges: Sequence[Path], rig_file: Path, directory: Path) -> Inference:
        return self.oracle(used, judges, rig_file, directory)

    def drive(self, step: ProgramStep, look: Callable[[], None]) -> ProgramRun:
        look()
        number = len(self.driven)
        program = self._programs[step.program]
        self.driven.append(program.name)
        name = f"20260101T0000{number:02d}Z_{program.name}"
        runs = self.directory / "runs"
        while (runs / name).exists():
            name = f"{name}+"
        shutil.copytree(self._run_of(program), runs / name)
        return ProgramRun(name, program.name)

    def enter(self, file: Path) -> bool:
        self.entered.append(file)
        return True

    def close(self) -> None:
        pass

    def _run_of(self, program: SessionProgram) -> Path:
        """A simulated run of a program. Each repetition is created once, with different noise."""
        is_corrected = program.name.endswith(FIXED) or bool(self.entered)
        repeat = len(list((self.directory / "runs").glob(f"*_{program.name}*")))
        kept = self.directory.parent / ("corrected" if is_corrected else "nominal") / str(repeat) / program.name
        if not kept.exists():
            kept.parent.mkdir(parents=True, exist_ok=True)
            hidden = kept.parent / "hidden.yaml"
            hidden.write_text(yaml.safe_dump(CORRECTED if is_corrected else HIDDEN))
            cell = self.directory / "cells" / f"{program.stage}.yaml"
            run = analysis.simulate(cell, program.test, program.direction, seed=3 + repeat, effects=hidden)
            analysis.save_run(_named(run, program.name), kept)
        return kept


def _named(run: analysis.Measured, name: str) -> analysis.Measured:
    manifest = run.run.manifest.updated(name=name)
    return replace(run, run=replace(run.run, manifest=manifest))


class Screen:
    """Collects the messages to the user."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.blocks: list[Block] = []

    def say(self, line: str) -> None:
        self.lines.append(line)

    def answer(self, blocks: Sequence[Block]) -> None:
        self.blocks += blocks

    def show(self, line: str) -> None:
        pass


class MortalPlace(SessionDirectory):
    """A session directory whose process dies at the next write, alternately before and after it."""

    def __init__(self, directory: Path, *, before: bool) -> None:
        super().__init__(directory)
        self.before, self.writes = before, 0

    def write(self, session: Session) -> None:
        if self.before:
            raise Killed
        super().write(session)
        raise Killed


@cache
def _planned(text: str, aim: str, minutes: float) -> tuple[tuple[Stage, ...], tuple[ProgramStep, ...]]:
    return planned(parse(text, "cell.yaml"), aim, minutes, BY_ITSELF, lambda _: None)  # type: ignore[arg-type]


def begun(cell: Path, directory: Path, minutes: float = 3.2, **asked: object) -> Session:
    rig, text = load(cell)
    wanted = {"aim": "faults", "maker": "kuka", **asked}
    stages, steps = _planned(text, str(wanted["aim"]), minutes)
    session = Session(
        rig=rig.name,
        rig_file=str(cell),
        rig_sha256=digest_of(text),
        minutes=minutes,
        began="2026-01-01T00:00:00+00:00",
        stages=stages,
        steps=steps,
        **wanted,
    )
    with SessionDirectory(directory) as place:
        place.write(session)
    return session


def gone_on(
    directory: Path,
    driver: Simulated,
    oracle: Oracle,
    place: SessionDirectory | None = None,
    screen: Screen | None = None,
) -> Session:
    """Continue a session to its end or its next death, and return it."""
    with place or SessionDirectory(directory) as held:
        session = held.read()
        rig, text = load(session.rig_file)
        driver.oracle = oracle
        return Conductor(rig, text, held, session, driver, screen or Screen(), asked_for(session)).run()


def asked_for(session: Session) -> SessionOptions:
    """Options of a session of an emulated cell without an operator."""
    return SessionOptions(session.rig_file, session.aim, session.minutes, session.maker, Emulated(), "ada", 1.0)
