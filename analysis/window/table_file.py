"""The table of a run as a file, without marking the run as exported: what a browser keeps may be lost."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

from analysis.files.write import Writer, write_csv, write_new, write_parquet, write_xlsx
from analysis.traces.loading import load_measured
from rigs.errors import RigError
from rigs.text import plain

WRITERS = {"csv": write_csv, "parquet": write_parquet, "xlsx": write_xlsx}


def main() -> None:
    """Write the table of a run (first argument) to a file (second), in the format that its suffix names."""
    run, file = (Path(argument) for argument in sys.argv[1:3])
    try:
        table = load_measured(run).to_table()
        write: Writer = partial(WRITERS[file.suffix[1:]], table)
        write_new(file, write)
    except RigError as error:
        print(plain(str(error)), file=sys.stderr)
        sys.exit(error.exit_code)
