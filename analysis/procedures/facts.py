"""Facts of a kind of test for computations, and its labels for screen and page: `facts` and `labels` of its class."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from analysis.runs.table_format import format_of
from rigs.errors import FileError
from rigs.schema.vocabulary import TestName


@dataclass(frozen=True)
class Facts:
    """Properties of a test's readings and of its set-up."""

    of_places: bool = False
    """A reading is a position, three coordinates of a target or ball on the tool."""
    of_tracker: bool = False
    """An instrument measures the positions. It may have any place, and may read joints before they rest."""
    constants_apart: bool = False
    """The readings alone determine the constants of an arm, which then have separate prior widths."""
    setup_terms: int = 4
    frame_terms: int = 0
    """Leading set-up terms of the instrument or socket. The others belong to the target on the tool, common to all
    placements.
    """
    wild_spreads: float = 10.0
    """Robust standard deviations from which a reading is an outlier relative to a calibrated arm. The standard
    deviation is at least the largest of real cells, 0.06 mm. Chosen: as for the sphere of a radial test.
    """
    assumed_sd_mm: float = math.nan
    """Standard deviation of a coordinate if no position was visited twice."""


@dataclass(frozen=True)
class Labels:
    """Words of a test for screen and page."""

    example: tuple[str, float, float] | None = None
    """Figure with bounds for warning and failure, of the size of the values in docs/rig-file.md, to be replaced."""
    part: str = ""
    """Section of `tests` in a rig file describing place and motion of the test."""
    further: tuple[str, str] | None = None
    """Name in a plan as an additional test in a rig file with that section, and the reason for adding it."""
    along: str = "place"
    """Abscissa of the curve in a table of measured and simulated values."""
    setup: str = "the ball's position and the gauges' zeros"
    no_repeats: str = ""
    """Message if no reading was repeated; empty if it is that of all tests."""
    no_scale: str = ""
    """Message if no distance is known; empty if the readings are lengths."""
    joints_fit: str = "rows match the path of the test"
    """Predicate of a message about rows whose joints have the labelled meaning."""
    rows: str = "targets"
    distance_from: str = ""
    """Origin of the distance of an outlier."""
    outlier_check: str = ""
    """What to check for an outlier."""
    unsupported_reason: str = ""
    """Reason why the test reveals nothing about single joints; empty if it does."""


def facts_of(test: TestName) -> Facts:
    """Facts of a test. Raises FileError if the package that offers it is unusable."""
    kind: Any = format_of(test)
    facts: Facts = kind.facts
    return facts


def labels_of(test: TestName) -> Labels:
    """Labels of a test. Raises FileError if the package that offers it is unusable."""
    kind: Any = format_of(test)
    labels: Labels = kind.labels
    return labels


def shows_joints(test: TestName) -> bool:
    """True if a test reveals single joints of an arm, as a diagnosis requires."""
    return not labels_of(test).unsupported_reason


def no_joints_error(test: TestName, where: str) -> FileError:
    """Error for a test that reveals nothing about the joints of an arm."""
    return FileError(where, labels_of(test).unsupported_reason, "give poses, touches or circles", code="test.no_joints")
