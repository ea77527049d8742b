"""Whether a recorded run is a measurement, asked while the robot can still drive it again."""

from __future__ import annotations

from pathlib import Path

from analysis.conventions.check import why_no_measurement
from analysis.measures.results import result_of
from analysis.traces.loading import measured_of
from daq.store import read_run
from rigs.errors import FileError
from rigs.schema.vocabulary import WITHOUT_GAUGES


def why_unusable(run: Path) -> str:
    """Return why `rig analyse` would refuse a run, or a convention shows that it is none; empty where it is good."""
    try:
        recorded = read_run(run)
        if recorded.manifest.test not in WITHOUT_GAUGES:  # which has a table of its own
            measured = measured_of(recorded)
            if why := why_no_measurement(measured):
                return why
            result_of(measured)
    except FileError as error:
        return error.what
    return ""
