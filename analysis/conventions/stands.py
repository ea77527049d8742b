"""Several readings of one stand that were given as so many visits: their means are used, and it is said."""

from __future__ import annotations

from collections.abc import Iterator

from analysis.conventions.finding import Finding
from analysis.traces.csv_tables import table_from
from analysis.traces.loading import Measured
from analysis.traces.single_stands import rows_a_stand
from analysis.traces.tables import CircleTable

STANDS = "stands"


def stand_findings(run: Measured) -> Iterator[Finding]:
    """How many rows of an imported run were several readings of one stand."""
    manifest, table = run.run.manifest, run.run.table
    if table is None or isinstance(run.table, CircleTable):
        return
    counts = rows_a_stand(table_from(table, manifest.test, manifest.direction, str(run.path)))
    several = counts[counts > 1]
    if not len(several):
        return
    stands = "1 stand" if len(several) == 1 else f"{len(several)} stands"
    what = (
        f"{several.sum()} rows are {stands} of the robot, read up to {several.max()} times without a move: their "
        "means are used, one for each"
    )
    remedy = "if the robot moved in between, give the rows of a pose after those of another"
    yield Finding(STANDS, "likely", (), "readings of one stand", what, remedy)
