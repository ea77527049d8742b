"""Recovery of crashed runs at start-up, in a separate thread, so that reading can start immediately.

Unclear cases, such as an unreadable manifest, are logged, and left to the operator and `rig recover`.
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


class StartupRecovery(clock.StoppableThread):
    """Recovers all unclosed runs of a directory, latest first. An interrupted recovery can be repeated."""

    def __init__(self, runs: Path) -> None:
        super().__init__("recover")
        self._runs = runs

    def run(self) -> None:
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
            except Exception:  # a damaged old run must not prevent recording
                log.exception("%s: not recovered because of an internal error; run: rig recover %s", path, path)


def _may_be_run(path: Path) -> bool:
    try:
        return path.is_dir() and any(file.name == MANIFEST or parse_chunk(file.name) for file in path.iterdir())
    except OSError as error:  # such as lost+found on a separate disk
        log.info("%s: not searched for a crashed run: %s", path, error.strerror)
        return False


def recover_and_log(path: Path) -> None:
    done = recover(path)
    if done.nothing_to_do:
        return
    rows = ", ".join(f"{count} of {stream}" for stream, count in done.rows.items()) or "none"
    log.info("recovered %s, which was not closed: recovered rows: %s", path, rows)
    for file, loss in done.losses.items():
        log.warning("%s: %s: %s", path, file, loss)
