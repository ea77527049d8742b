"""Tables and URLs in place of run directories: local runs that keep the name given by the user.

fsspec, an optional extra, copies the runs at a URL (`s3://bucket/plant`, `sftp://host/srv/plant`) once.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from daq.store.durable import TEMPORARY
from daq.store.ledger import LEDGER, to_recover
from daq.store.manifest import MANIFEST
from daq.store.marks import MARKS
from rigs.calibration import CALIBRATION
from rigs.distribution import to_install
from rigs.errors import CellError, FileError, RigError

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.:-]*://.")
_SECRET = re.compile(r"//[^/@]*:(?!\d+/)[^@]*@|^https?://[^?]*\?", re.DOTALL)
"""A password, which may contain slashes unlike the port of a host, or the query of a signed link."""
_READ = (MANIFEST, LEDGER, MARKS, TEMPORARY, CALIBRATION, ".parquet", ".arrow")
"""Ends of the names of files that rig reads in a run."""
_LONGEST = 200
_copies: list[TemporaryDirectory[str]] = []
"""Copies of runs; each is removed when the command ends."""
if TYPE_CHECKING:
    _Path = Path
else:
    _Path = type(Path())  # Path itself cannot be subclassed before Python 3.12


class CopiedRun(_Path):
    """A table or URL of the user in place of a run or a directory of runs. run: its local copy."""

    run: Path
    _text: str

    @classmethod
    def of(cls, text: str, run: Path) -> CopiedRun:
        made = cls(text)
        made.run, made._text = run, text
        return made

    def __str__(self) -> str:
        return getattr(self, "_text", None) or super().__str__()  # a parent has no text of its own

    def __reduce__(self) -> tuple[object, ...]:
        return CopiedRun.of, (self._text, self.run)

    def absolute(self) -> CopiedRun:
        return self

    def resolve(self, strict: bool = False) -> CopiedRun:
        return self


def location(text: str) -> Path:
    """Parse a local path, or copy the runs at a URL. Raises FileError if they cannot be copied."""
    if not _URL.match(text):
        return Path(text)
    if _SECRET.search(text):
        remedy = "remove it: credentials are taken from keys, from ~/.aws or from the settings of fsspec"
        problem = "contains a password or a key, which others on this computer can see"
        raise FileError(f"{text.partition(':')[0]}://…", problem, remedy, code="address.invalid")
    _copies.append(TemporaryDirectory(prefix="rig-"))
    into = Path(_copies[-1].name)
    try:
        _copy(text, into)
    except RigError:
        raise
    except ImportError as error:
        problem = f"needs a Python package that is not installed: {_reason(error)}"
        raise FileError(text, problem, to_install("s3fs", "sshfs"), code="package.missing") from None
    except Exception as error:  # noqa: BLE001 - every package has errors of its own
        remedy = "check the URL, the network and the credentials; or copy the runs with rclone, and give the directory"
        raise FileError(text, f"cannot be read: {_reason(error)}", remedy, code="file.unreadable") from None
    return CopiedRun.of(text.rstrip("/"), into)


def _copy(url: str, into: Path) -> None:
    """Copy the files that rig reads, without names that lead out of the directory. Raises errors of the packages."""
    import fsspec  # noqa: PLC0415 - an extra

    if url.startswith(("sftp:", "ssh:")):
        import sshfs  # noqa: F401, PLC0415 - else fsspec takes paramiko, which accepts any host key

        fsspec.config.conf.setdefault(url.partition(":")[0], {}).setdefault("known_hosts", ())  # ~/.ssh/known_hosts
    store, top = fsspec.core.url_to_fs(url)
    files: dict[str, str] = {}
    for file in store.find(top):
        below = file.removeprefix(top.rstrip("/")).strip("/")
        if below.endswith(_READ) and not {"..", ""} & {*below.split("/")} and not {"\\", "\0"} & {*below}:
            files[file] = str(into / below)
    if not files:
        raise FileError(url, "contains no runs", "give the URL of a run or of a directory of runs", code="run.missing")
    store.get([*files], [*files.values()])


def _reason(error: Exception) -> str:
    """Text of an error, without passwords and signatures in URLs."""
    words = " ".join(str(error).split()) or type(error).__name__
    words = re.sub(r"(://[^\s?]*)\?[^\s'\"]*", r"\1", re.sub(r"//[^/@\s]*@", "//", words))
    return words[:_LONGEST].rstrip(".")


@contextmanager
def local_run(run: Path) -> Iterator[Path]:
    """Provide the local directory of a run. Errors in the block name the table or URL that the user gave."""
    if not isinstance(run, CopiedRun):
        yield run
        return
    try:
        yield run.run
    except RigError as error:
        kind: Any = FileError if isinstance(error, FileError) else CellError
        texts = (error.where, error.what, error.remedy)
        raise kind(*(restore_run_path(text, run.run, run) for text in texts), code=error.code) from None


def restore_run_path(text: str, copy: Path, run: Path) -> str:
    if copy == run:
        return text
    return text.replace(to_recover(copy), "run `rig recover` on a copy of the run").replace(str(copy), str(run))
