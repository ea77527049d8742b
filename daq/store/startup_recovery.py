"""Recovery of the runs that a crash left behind, at the next start: in a thread of its own, so reading begins at once.

Only what a crash of the store can leave is touched: a run whose manifest can be read, that was not
closed, and that no process holds the lock of; another daemon may share the directory. Anything else is
reported and left to a person and `rig recover`.
"""

from __future__ import annotations

import logging
from pathlib import Path

from daq import clock
from daq.store import is_unclosed, recover
from daq.store.ledger import parse_chunk
from daq.store.manifest import MANIFEST
from rigs.errors import RigError

log = logging.getLogger("rigd")


class StartupRecovery(clock.Thread):
    """Recovers every unclosed run of a directory, the latest first, and ends."""

    def __init__(self, runs: Path) -> None:
        super().__init__(name="recover", daemon=True)
        self._runs = runs
        self._stop_asked = clock.Event()

    def stop(self) -> None:
        """Ask the thread to end after the run it is at; a recovery that is cut off can be done again."""
        self._stop_asked.set()

    def run(self) -> None:
        """Recover the runs until `stop`: the body of the thread."""
        try:
            paths = sorted(filter(_may_be_run, self._runs.iterdir()), reverse=True)
        except FileNotFoundError:
            return
        except OSError as error:
            log.warning("%s: cannot be searched for crashed runs: %s", self._runs, error.strerror)
            return
        for path in paths:
            if self._stop_asked.is_set():
                return
            try:
                if is_unclosed(path):
                    recover_and_log(path)
            except RigError as error:
                log.warning("not recovered: %s", error)
            except Exception:  # no odd old run may keep the cell from recording new ones
                log.exception("%s: not recovered because of an internal error; run: rig recover %s", path, path)


def _may_be_run(path: Path) -> bool:
    """Return whether this may be a run: not other directories, nor a start that was cut off before any recording."""
    try:
        return path.is_dir() and any(file.name == MANIFEST or parse_chunk(file.name) for file in path.iterdir())
    except OSError as error:  # as lost+found, where the runs have a disk of their own
        log.info("%s: not searched for a crashed run: %s", path, error.strerror)
        return False


def recover_and_log(path: Path) -> None:
    """Recover one run and log what came of it. Raises RigError."""
    done = recover(path)
    if done.nothing_to_do:
        return
    rows = ", ".join(f"{count} of {stream}" for stream, count in done.rows.items()) or "none"
    log.info("recovered %s, which was not closed: rows brought back: %s", path, rows)
    for file, loss in done.losses.items():
        log.warning("%s: %s: %s", path, file, loss)
