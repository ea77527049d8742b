"""Records of a test: facts for computations, and labels for screen and page.

Each test provides them as `FACTS` and `LABELS` in its package. A test without them has the usual values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from analysis.runs.parts_of_tests import package_of
from rigs.errors import FileError
from rigs.schema.vocabulary import TestName


@dataclass(frozen=True)
class Facts:
    """Properties of a test's readings and of its set-up.

    of_places: True if a reading is a position, three coordinates of a target or ball on the tool.
    of_tracker: True if an instrument measures the positions. It may have any place, and may read joints before they
    rest.
    constants_apart: True if the readings alone determine the constants of an arm, which then have separate prior
    widths.
    setup_terms: number of fitted set-up terms.
    frame_terms: number of leading set-up terms that belong to the instrument or socket. The others belong to the target
    on the tool, common to all placements.
    wild_spreads: robust standard deviations from which a reading is an outlier relative to a calibrated arm. The
    standard deviation is at least the largest of real cells, 0.06 mm. Chosen: as for the sphere of a radial test.
    assumed_sd_mm: standard deviation of a coordinate if no position was visited twice.
    """

    of_places: bool = False
    of_tracker: bool = False
    constants_apart: bool = False
    setup_terms: int = 4
    frame_terms: int = 0
    wild_spreads: float = 10.0
    assumed_sd_mm: float = math.nan


@dataclass(frozen=True)
class Labels:
    """Words of a test for screen and page.

    example: figure with bounds for warning and failure, of the size of the values in docs/rig-file.md, to be replaced.
    part: section of `tests` in a rig file describing place and motion of the test.
    further: name in a plan as an additional test in a rig file with that section, and the reason for adding it.
    along: abscissa of the curve in a table of measured and simulated values.
    setup: description of the set-up terms.
    no_repeats: message if no reading was repeated; empty if the message is common to all tests. no_scale: message if no
    distance is known; empty if the readings are lengths.
    joints_fit: predicate of a message about rows whose joints have the labelled meaning.
    rows: name of the rows.
    distance_from: origin of the distance of an outlier.
    outlier_check: subject to check for an outlier.
    unsupported_reason: reason why the test reveals nothing about single joints; empty if it does.
    """

    example: tuple[str, float, float] | None = None
    part: str = ""
    further: tuple[str, str] | None = None
    along: str = "place"
    setup: str = "the ball's position and the gauges' zeros"
    no_repeats: str = ""
    no_scale: str = ""
    joints_fit: str = "rows match the path of the test"
    rows: str = "targets"
    distance_from: str = ""
    outlier_check: str = ""
    unsupported_reason: str = ""


_USUAL_FACTS, _USUAL_LABELS = Facts(), Labels()


def facts_of(test: TestName) -> Facts:
    """Return the facts of a test. Raises FileError if its package is unusable."""
    facts: Facts = getattr(package_of(test), "FACTS", _USUAL_FACTS)
    return facts


def labels_of(test: TestName) -> Labels:
    """Return the labels of a test. Raises FileError if its package is unusable."""
    labels: Labels = getattr(package_of(test), "LABELS", _USUAL_LABELS)
    return labels


def shows_joints(test: TestName) -> bool:
    """Return whether a test reveals single joints of an arm, as a diagnosis requires."""
    return not labels_of(test).unsupported_reason


def no_joints_error(test: TestName, where: str) -> FileError:
    """Return the error for a test that reveals nothing about the joints of an arm."""
    return FileError(where, labels_of(test).unsupported_reason, "give poses, touches or circles")
