"""Values used by many tests and changed by none, computed once for all test processes and cached on disk.

    @made_once
    def plan_of(tests: tuple[TestName, ...]) -> Plan:
        return plan(RIG, tests)

The first process that calls `plan_of(("yaw",))` computes the value. Other processes wait for it, and all later calls
read the cache. A change of the product, the locked packages, Python, `tests/support` or the file of the function
invalidates the cache.
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
"""Age after which an unused cache is deleted, in s."""
P = ParamSpec("P")
T = TypeVar("T")


def made_once(make: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function so that its return value, which must support pickling, is cached on disk for each set of
    arguments.

    All tests of a process share the value and must not change it.
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
    asked = hashlib.sha256(Path(make.__code__.co_filename).read_bytes() + pickle.dumps(arguments)).hexdigest()
    return _folder() / f"{make.__module__}.{make.__qualname__}-{asked[:16]}"


@cache
def _folder() -> Path:
    """Cache directory for the current sources, and delete caches that have been unused for long."""
    folder = KEPT / source_hash(ROOT)
    folder.mkdir(parents=True, exist_ok=True)
    os.utime(folder)
    for other in KEPT.iterdir():
        if time.time() - other.stat().st_mtime > UNUSED_S:
            shutil.rmtree(other, ignore_errors=True)
    return folder


def source_hash(root: Path) -> str:
    """A hash of everything that determines a cached value: names and contents of the sources at `root`, and
    Python.
    """
    found = hashlib.sha256(sys.version.encode())
    files = [path for name in SOURCES for path in (root / name).rglob("*") if path.is_file()]
    for path in sorted([*(root / "scripts").glob("*.lock"), *files]):
        if "__pycache__" not in path.parts:
            content = path.read_bytes()
            found.update(f"{path.relative_to(root)}\0{len(content)}\0".encode() + content)
    return found.hexdigest()[:16]


@contextmanager
def _locked(file: Path) -> Generator[None, None, None]:
    """Hold the lock of a cache file. It is released when the process ends."""
    with _beside(file, "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _beside(file: Path, what: str) -> Path:
    return file.with_name(f"{file.name}.{what}")


def _put(file: Path, data: bytes) -> None:
    part = _beside(file, "part")
    part.write_bytes(data)
    part.replace(file)
