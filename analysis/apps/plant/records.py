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
from analysis.procedures.results import result_of
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.test_kind import labels_of
from analysis.runs.loading import load_measured
from daq.store import Manifest
from daq.store.chunk import storable
from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST
from rigs.errors import FileError
from rigs.files import read_bytes
from rigs.schema.vocabulary import DrivenTest

_MOST_BYTES = 1_000_000_000
_NOT_OF_THE_PROGRAM = {"eccentricity_mm", "laps", "visits"}


@dataclass(frozen=True)
class RunRecord:
    """A run in the history."""

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
        """A line of JSON with lone surrogates escaped."""
        figures = {name: astuple(quantity) for name, quantity in self.figures.items()}
        return json.dumps(vars(self) | {"figures": figures, "problem": storable(self.problem)})

    @classmethod
    def of_json(cls, line: str) -> RunRecord:
        """Raises TypeError or ValueError for an invalid line."""
        fields = json.loads(line)
        try:
            return cls(**fields | {"figures": {name: Quantity(*figure) for name, figure in fields["figures"].items()}})
        except (AttributeError, LookupError) as error:
            raise ValueError(f"is not a record: {error}") from None

    @property
    def title(self) -> str:
        """`yaw acw`."""
        return f"{self.test} {self.direction}".strip()

    @property
    def key(self) -> tuple[str, str, str, str]:
        """Runs with equal keys are comparable."""
        return self.title, self.placement, self.program, self.corrected

    @property
    def when(self) -> datetime:
        when = datetime.fromisoformat(self.started)
        when = when if when.tzinfo else when.replace(tzinfo=UTC)
        try:
            return when.astimezone()
        except OverflowError:  # Within a day of the first or last year
            return when


def fingerprint_of(run: Path) -> str:
    """Digest of manifest, ledger and file sizes; the ledger contains the digest of every chunk."""
    digest = hashlib.sha256()
    for name in (MANIFEST, LEDGER):
        path = run / name
        digest.update(hashlib.sha256(read_bytes(path, _MOST_BYTES) if path.exists() else b"").digest())
    for path in sorted((*run.glob("*.parquet"), *run.glob("*.arrow"))):
        digest.update(f"{path.name} {path.stat().st_size}\n".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()


def record_of(path: Path, manifest: Manifest, fingerprint: str) -> RunRecord:
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
            figures = result.figures | joint_plays(result)
            for axis, joint in (measured.condition.warmth or {}).items():
                # u is the variation of the readings; makers do not state the accuracy of the sensors.
                figures[f"temperature_j{axis}_c"] = Quantity(joint.mean_c, joint.u_mean_c, "c")
                figures[f"warming_j{axis}_c"] = Quantity(joint.rise_c, joint.u_rise_c, "c")
    except FileError as error:
        problem = error.what
    except (ArithmeticError, ValueError, RuntimeWarning, np.linalg.LinAlgError) as error:
        problem = f"the computation failed: {error}"
    return replace(
        record_without_figures(path.name, manifest, problem), fingerprint=fingerprint, program=program,
        figures=figures, readings=readings, simulated=simulated,
    )  # fmt: skip


def record_without_figures(name: str, manifest: Manifest | None, problem: str) -> RunRecord:
    if manifest is None:
        return RunRecord(name, "", "", "", "", "", "", problem=problem)
    return RunRecord(
        name, "", manifest.rig_name, manifest.started, manifest.test, manifest.direction or "", manifest.placement,
        problem=problem, corrected=manifest.corrected,
    )  # fmt: skip


def in_time(records: Iterable[RunRecord]) -> list[RunRecord]:
    return sorted(records, key=lambda record: (record.when.timestamp(), record.name))
