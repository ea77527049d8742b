"""History record of a run: description and figures, or the reason for missing figures.

Joint temperatures are figures too, because gears and links expand with them.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Iterable
from dataclasses import astuple, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import get_args

import numpy as np

from analysis.apps.plant.joint_play import joint_plays
from analysis.procedures.facts import labels_of
from analysis.procedures.results import result_of
from analysis.procedures.shared.quantity import Quantity
from analysis.runs.loading import load_measured
from analysis.runs.robot_condition import Condition
from daq.store import Manifest, RunInfo
from daq.store.chunk import storable
from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST
from rigs.errors import FileError
from rigs.files import read_bytes
from rigs.schema.vocabulary import DrivenTest


def joint_warmth(condition: Condition) -> dict[str, Quantity]:
    """Return the temperatures of joints as figures: the mean `temperature_j1_c` … and the rise `warming_j1_c` … in the
    run.

    u is the variation of the readings; makers do not state the accuracy of the sensors.
    """
    shown = condition.warmth or {}
    means = {f"temperature_j{axis}_c": Quantity(joint.mean_c, joint.u_mean_c, "c") for axis, joint in shown.items()}
    rises = {f"warming_j{axis}_c": Quantity(joint.rise_c, joint.u_rise_c, "c") for axis, joint in shown.items()}
    return means | rises


_MOST_BYTES = 1_000_000_000
"""Maximum size of a ledger, as in the store."""
_NOT_OF_THE_PROGRAM = {"eccentricity_mm", "laps", "visits"}
"""Keys that differ between cells and runs of the same program, and only affect the uncertainty of a figure."""


@dataclass(frozen=True)
class RunRecord:
    """A run in the history: directory name, fingerprint, start (ISO 8601), test, and figures.

    problem: reason for missing figures, in a line. program: short digest of circle or hemisphere in the rig file.
    readings: digest of the measurements, empty if unreadable. simulated: whether no real robot was measured. corrected:
    correction during the run, according to the manifest.
    """

    name: str
    fingerprint: str
    rig: str
    started: str
    test: str
    direction: str
    placement: str
    program: str = ""
    problem: str = ""
    figures: dict[str, Quantity] = field(default_factory=dict)
    readings: str = ""
    simulated: bool = False
    corrected: str = ""

    @property
    def as_json(self) -> str:
        """The record as a line of JSON for `of_json`, with lone surrogates escaped."""
        figures = {name: astuple(quantity) for name, quantity in self.figures.items()}
        return json.dumps(vars(self) | {"figures": figures, "problem": storable(self.problem)})

    @classmethod
    def of_json(cls, line: str) -> RunRecord:
        """Parse a line of JSON. Raises TypeError or ValueError if it is invalid."""
        fields = json.loads(line)
        try:
            return cls(**fields | {"figures": {name: Quantity(*figure) for name, figure in fields["figures"].items()}})
        except (AttributeError, LookupError) as error:
            raise ValueError(f"is not a record: {error}") from None

    @property
    def title(self) -> str:
        """Test and direction, such as `yaw acw`."""
        return f"{self.test} {self.direction}".strip()

    @property
    def when(self) -> datetime:
        """Start of the run in the time zone of this computer, used for counting days. Raises ValueError."""
        when = datetime.fromisoformat(self.started)
        when = when if when.tzinfo else when.replace(tzinfo=UTC)
        try:
            return when.astimezone()
        except OverflowError:  # Within a day of the first or last year
            return when


def fingerprint_of(run: Path) -> str:
    """Return the SHA-256 of the manifest, ledger and file sizes of a run; the ledger contains the SHA-256 of every
    chunk.

    Raises OSError or FileError.
    """
    digest = hashlib.sha256()
    for name in (MANIFEST, LEDGER):
        path = run / name
        digest.update(hashlib.sha256(read_bytes(path, _MOST_BYTES) if path.exists() else b"").digest())
    for path in sorted((*run.glob("*.parquet"), *run.glob("*.arrow"))):
        digest.update(f"{path.name} {path.stat().st_size}\n".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()


def record_of(path: Path, manifest: Manifest, fingerprint: str) -> RunRecord:
    """Evaluate a run, independent of other runs. Never raises for a bad run."""
    program, problem, readings, simulated = "", "", "", False
    figures: dict[str, Quantity] = {}
    try:
        datetime.fromisoformat(manifest.started)
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # A figure that becomes NaN is not a result.
            measured = load_measured(path)
            readings, simulated = measured.run.readings_sha256, measured.is_simulated
            # Digest of the robot program: figures of different programs are not comparable
            is_driven = manifest.test in get_args(DrivenTest)
            part = getattr(measured.rig.tests, labels_of(manifest.test).part) if is_driven else None
            driven = part.model_dump(mode="json", exclude=_NOT_OF_THE_PROGRAM) if part else {}
            program = hashlib.sha256(json.dumps(driven, sort_keys=True).encode()).hexdigest()[:8]
            result = result_of(measured)
            figures = result.figures | joint_plays(result) | joint_warmth(measured.condition)
    except FileError as error:
        problem = error.what
    except (ArithmeticError, ValueError, RuntimeWarning, np.linalg.LinAlgError) as error:
        problem = f"the computation failed: {error}"
    plain = _plain_record(path, manifest, fingerprint, program, problem, figures)
    return replace(plain, readings=readings, simulated=simulated)


def record_without_figures(run: RunInfo, problem: str) -> RunRecord:
    """Return the record of a run that cannot be evaluated in its present state."""
    if run.manifest is None:
        return RunRecord(run.path.name, "", "", "", "", "", "", problem=problem)
    return _plain_record(run.path, run.manifest, "", "", problem, {})


def _plain_record(
    path: Path, manifest: Manifest, fingerprint: str, program: str, problem: str, figures: dict[str, Quantity]
) -> RunRecord:
    return RunRecord(
        path.name,
        fingerprint,
        manifest.rig_name,
        manifest.started,
        manifest.test,
        manifest.direction or "",
        manifest.placement,
        program,
        problem,
        figures,
        corrected=manifest.corrected,
    )


def in_time(records: Iterable[RunRecord]) -> list[RunRecord]:
    """Sort records by the start of the runs."""
    return sorted(records, key=lambda record: (record.when.timestamp(), record.name))
