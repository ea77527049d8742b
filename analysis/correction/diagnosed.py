"""The diagnosis of the Python API: the result of the judgement, with its model as files and as a calibrated arm."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path

from analysis.correction.calibrated_arm import CalibratedArm
from analysis.correction.model_files import extended_files, with_provenance
from analysis.diagnosis.judge import result
from analysis.runs.written_files import holding, write_all_new
from rigs.errors import FileError


@dataclass(frozen=True, kw_only=True, repr=False)
class Diagnosis(result.Diagnosis):
    """The complete result of a diagnosis, which can write its model and give the calibrated arm."""

    rig_text: str = ""
    """Text of the initial rig file; empty if the model was given as an object that no run contains."""

    @classmethod
    def of(cls, diagnosis: result.Diagnosis, rig_text: str) -> Diagnosis:
        values = {field.name: getattr(diagnosis, field.name) for field in fields(diagnosis)}
        return cls(**{**values, "rig_text": rig_text})

    def calibrated_arm(self) -> CalibratedArm:
        """Arm with the calibrated model of this diagnosis. Raises FileError if the runs determine no model."""
        self._require_model("calibrated_arm()")
        return CalibratedArm(self.extended_rig)

    def save(self, directory: str | Path) -> Path:
        """Write the calibrated model and the answer to a new or empty directory, as `rig diagnose -o` does, and return
        the path of the rig file. Raises FileError if a file exists, or if the runs determine no model.
        """
        directory = Path(directory)
        self._require_model(str(directory))
        if not self.rig_text:
            remedy = "give `rig` as the path of a rig file"
            raise FileError("rig", "is an object, so its text is unknown", remedy, code="argument.invalid")
        rig_file = directory / f"{self.rig.name}.yaml"
        answer = (json.dumps(self.to_dict(), indent=2) + "\n").encode()
        files = extended_files(self.rig_text, with_provenance(self), rig_file, self.calibrated)
        write_all_new(directory, {"diagnosis.json": holding(answer), **files})
        return rig_file

    def _require_model(self, where: str) -> None:
        if not self.is_modelled or self.calibrated is None:
            problem = f"the diagnosis has no calibrated model: its condition is {self.condition}"
            raise FileError(where, problem, "measure what `next_test` and `acts` ask for", code="calibration.missing")
