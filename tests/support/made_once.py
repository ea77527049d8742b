"""What many tests look at and none changes, made once for all processes of the tests and kept on disk between runs.

    @made_once
    def plan_of(tests: tuple[TestName, ...]) -> Plan:
        return plan(RIG, tests)

The first process that calls `plan_of(("yaw",))` makes it, any other that asks meanwhile waits, and all later ones read
it. It is never stale: a change of the product, of the locked packages, of Python, of `tests/support` or of the file of
the function makes it again.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
import shutil
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import cache, wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

ROOT = Path(__file__).parents[2]
KEPT = ROOT / ".pytest_cache" / "made_once"
SOURCES = ("analysis", "daq", "rigs", "tests/support", "tests/worlds", "tests/trials")
UNUSED_S = 7 * 24 * 3600.0
"""How long a set is kept that no run of the tests has used."""
P = ParamSpec("P")
T = TypeVar("T")


def made_once(make: Callable[P, T]) -> Callable[P, T]:
    """Return what `make` returns for the same arguments, a value that can be pickled, from the first call on the disk.

    The value is shared by all tests of a process: none may change it.
    """

    @wraps(make)
    def made(*args: P.args, **kwargs: P.kwargs) -> T:
        file = _file(make, (args, kwargs))
        with _locked(file):
            if not file.exists():
                _put(file, pickle.dumps(make(*args, **kwargs), pickle.HIGHEST_PROTOCOL))
        return pickle.loads(file.read_bytes())  # type: ignore[no-any-return]  # noqa: S301 - written above

    return cache(made)  # type: ignore[return-value]


def _file(make: Callable[..., object], arguments: object) -> Path:
    """Where the value of a function for its arguments is kept."""
    asked = hashlib.sha256(Path(make.__code__.co_filename).read_bytes() + pickle.dumps(arguments)).hexdigest()
    return _folder() / f"{make.__module__}.{make.__qualname__}-{asked[:16]}"


@cache
def _folder() -> Path:
    """The folder of what the files of today make; those that no run has used for long are removed."""
    folder = KEPT / source_hash(ROOT)
    folder.mkdir(parents=True, exist_ok=True)
    os.utime(folder)
    for other in KEPT.iterdir():
        if time.time() - other.stat().st_mtime > UNUSED_S:
            shutil.rmtree(other, ignore_errors=True)
    return folder


def source_hash(root: Path) -> str:
    """The hash of what makes a value in the tree at `root`: names and contents of its sources, and Python."""
    found = hashlib.sha256(sys.version.encode())
    files = [path for name in SOURCES for path in (root / name).rglob("*") if path.is_file()]
    for path in sorted([*(root / "scripts").glob("*.lock"), *files]):
        if "__pycache__" not in path.parts:
            content = path.read_bytes()
            found.update(f"{path.relative_to(root)}\0{len(content)}\0".encode() + content)
    return found.hexdigest()[:16]


@contextmanager
def _locked(file: Path) -> Generator[None, None, None]:
    """Hold the lock of what is to be made; it ends with the process that holds it."""
    with _beside(file, "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _beside(file: Path, what: str) -> Path:
    return file.with_name(f"{file.name}.{what}")


def _put(file: Path, data: bytes) -> None:
    part = _beside(file, "part")
    part.write_bytes(data)
    part.replace(file)
