"""Remote file stores through fsspec: list directories, find runs, and report failures in one line.

fsspec is an optional extra, and the package of each protocol raises different errors. They are classified here by
remedy: install a package, check the URL, request access, or wait for the network.

Runs below a URL are found by listing file names. An object store lists a thousand objects per request regardless of
directories, so it is listed at once; other stores need a request per directory. A separate process does this: store
packages start threads, which a forking process must not have, and a waiting process can be ended by Ctrl-C.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from analysis.runs.batch.outcomes import FailedItem
from analysis.runs.batch.processes import in_processes
from analysis.runs.batch.remote_path import RemotePath
from daq.store.durable import TEMPORARY
from daq.store.ledger import LEDGER
from daq.store.manifest import MANIFEST, OF_A_RUN
from daq.store.marks import MARKS
from rigs.calibration import CALIBRATION
from rigs.distribution import to_install
from rigs.errors import CellError, FileError, RigError

NO_RUNS = "lost+found"
"""A directory at the top of a file system with access for root only."""
_CHUNKS = (".parquet", ".arrow")


def is_run(names: Iterable[str]) -> bool:
    """True if these file names belong to a run, however damaged. A ledger is sufficient, even if the manifest
    is missing."""
    return not OF_A_RUN.isdisjoint(names)


def has_figures(name: str) -> bool:
    """True if figures depend on a file. Marks of exports and protection do not affect figures."""
    return name in (MANIFEST, LEDGER) or name.endswith(_CHUNKS)


def is_read(name: str) -> bool:
    """True if reading or verifying a run uses a file."""
    return has_figures(name) or name == MARKS or name.endswith((TEMPORARY, CALIBRATION))


_PACKAGES = {"s3": "s3fs", "sftp": "sshfs", "ssh": "sshfs"}
"""fsspec packages of the protocols available as an extra."""
_SSH = ("sftp", "ssh")
_SSH_OPTIONS = {"known_hosts": (), "connect_timeout": 10, "keepalive_interval": 15}
"""Options of asyncssh: check host keys against ~/.ssh/known_hosts, which sshfs omits; time-outs in s for
unresponsive hosts, and for hosts that fall silent (three times the interval)."""
_STAMPS = ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified", "modified", "created")
"""Keys for the state of a file in the notations of the fsspec packages, most reliable first."""
_DENIED = {
    "PermissionError",
    "PermissionDenied",
    "SFTPPermissionDenied",
    "NoCredentialsError",
    "CredentialRetrievalError",
}
_LOST = {"ConnectionError", "TimeoutError", "EOFError", "gaierror"}
_LOST |= {"HTTPClientError", "ClientConnectionError", "ClientPayloadError"}  # botocore, aiohttp
_LOST |= {"DisconnectError", "SFTPConnectionLost", "SFTPNoConnection", "ChannelOpenError"}  # asyncssh
_UNREACHABLE = (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.EHOSTDOWN, None)
"""asyncio gives None if several addresses of a host refuse."""
_LONGEST = 200


class StoreLost(CellError):
    """The store does not respond: further requests would fail too."""


@dataclass(frozen=True)
class RemoteFile:
    """A file in a directory: name, size in bytes, and a stamp that changes with the file, empty if unavailable."""

    name: str
    size: int
    stamp: str


@contextmanager
def explained(where: RemotePath) -> Iterator[None]:
    """Convert exceptions of a store to RigError, and to StoreLost if it does not respond."""
    try:
        yield
    except (RigError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 - every package has errors of its own
        raise _explanation(where, error) from None


def opened(path: RemotePath) -> tuple[Any, str]:
    """Fsspec file system of a URL and the path in it. Raises exceptions of the packages."""
    import fsspec  # noqa: PLC0415 - an extra

    options: dict[str, Any] = {}
    if path.protocol in _SSH:
        import sshfs  # noqa: F401, PLC0415 - else fsspec takes paramiko, with whatever host key comes

        set_by_person = {key for protocol in _SSH for key in fsspec.config.conf.get(protocol, {})}
        options = {key: value for key, value in _SSH_OPTIONS.items() if key not in set_by_person}
    store, top = fsspec.core.url_to_fs(path.top, **options)
    return store, "/".join([top.rstrip("/"), *path.steps]) or "/"


def entries(store: Any, folder: str) -> tuple[list[RemoteFile], list[str]]:
    """Files and the subdirectory names of a directory, excluding links to directories.

    Raises exceptions of the packages.
    """
    files: list[RemoteFile] = []
    folders: list[str] = []
    store.invalidate_cache(folder)
    for listed in store.ls(folder, detail=True):
        name = name_below(folder, listed["name"])
        if "/" in name or not is_plain(name):
            continue
        if listed["type"] == "directory":
            folders += [] if listed.get("islink") else [name]
            continue
        with suppress(FileNotFoundError):  # a dangling link
            info = listed if listed["type"] == "file" and listed.get("size") is not None else store.info(listed["name"])
            files += [remote_file(name, info)] if info["type"] == "file" else []
    return sorted(files, key=lambda file: file.name), sorted(folders)


def remote_file(name: str, info: dict[str, Any]) -> RemoteFile:
    """A file from the information given by the store."""
    stamp = next((str(info[key]) for key in _STAMPS if info.get(key) is not None), "")
    return RemoteFile(name, int(info["size"]), stamp)


def name_below(folder: str, path: str) -> str:
    """Relative path of a file below a directory, or an empty text if it is elsewhere."""
    start = folder.rstrip("/") + "/"
    path = "/" + path if start.startswith("/") and not path.startswith("/") else path
    return path[len(start) :].rstrip("/") if path.startswith(start) else ""


def is_plain(name: str) -> bool:
    """True if a name is a plain file or directory name. Object keys can be any text."""
    return name not in ("", ".", "..") and not {"/", "\\", "\0"} & set(name)


def _explanation(where: RemotePath, error: Exception) -> RigError:
    kinds = {kind.__name__ for kind in type(error).__mro__}
    number = getattr(error, "errno", None)
    message, store = _reason(error), str(where)
    failure: RigError
    if isinstance(error, ImportError):
        problem = f"needs a Python package that is not installed: {message}"
        package = _PACKAGES.get(where.protocol)
        remedy = to_install(package) if package else "install it beside rig"
        failure = FileError(store, problem, remedy, code="package.missing")
    elif isinstance(error, ValueError) and "Protocol not known" in message:
        problem = "uses a protocol that fsspec does not support"
        failure = FileError(store, problem, "give s3://…, sftp://… or a directory", code="url.protocol")
    elif "HostKeyNotVerifiable" in kinds:
        remedy = "verify the host key and accept the key once with ssh, which adds the key to ~/.ssh/known_hosts"
        failure = CellError(store, "the computer's host key is unknown", remedy, code="store.host_key")
    elif kinds & _DENIED:
        problem = f"cannot be read (permission denied): {message}"
        failure = FileError(
            store, problem, "check the credentials, and the permission to list and read", code="store.denied"
        )
    elif isinstance(error, FileNotFoundError | NotADirectoryError):
        failure = FileError(
            store, "is not there", "check the URL: bucket or computer, and directory", code="url.missing"
        )
    elif number in (errno.ENOSPC, errno.EDQUOT):
        problem = "does not fit into the temporary directory"
        failure = CellError(store, problem, "set TMPDIR to a directory with more space", code="disk.full")
    elif kinds & _LOST or (type(error) is OSError and number in _UNREACHABLE):
        problem = f"the store does not answer: {message}"
        failure = StoreLost(
            store, problem, "check the network and the store, then repeat this command", code="store.silent"
        )
    else:
        remedy = "check the URL, the store and the settings of fsspec"
        failure = FileError(store, f"cannot be read: {message}", remedy, code="store.unreadable")
    return failure


def _reason(error: Exception) -> str:
    """Text of an error, with possible passwords and signatures removed from URLs."""
    words = " ".join((getattr(error, "strerror", None) or str(error)).split()) or type(error).__name__
    words = re.sub(r"(://[^\s?]*)\?[^\s'\"]*", r"\1", re.sub(r"//[^/@\s]*@", "//", words))
    return words[:_LONGEST].rstrip(".")


OBJECT_STORES = ("s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "oss", "oci", "r2")
Steps = tuple[str, ...]
"""Names of a directory relative to a second one."""


@dataclass(frozen=True)
class RemoteRun:
    """A remote run. files: in the directory, None if it cannot be listed."""

    path: RemotePath
    files: tuple[RemoteFile, ...] | None


def remote_runs(top: RemotePath) -> list[RemoteRun]:
    """Runs below a URL, or the run at the URL, in order of names. Raises RigError."""
    (outcome,) = in_processes(listed, [top], 1)
    if isinstance(outcome, FailedItem):
        raise outcome.error
    return outcome.value


def listed(top: RemotePath) -> list[RemoteRun]:
    """Runs, and directories that may contain runs, in this process. Nested runs are excluded."""
    runs: list[RemoteRun] = []
    run: Steps | None = None
    with explained(top):
        store, folder = opened(top)
        folders = _of_objects(store, folder) if top.protocol in OBJECT_STORES else _walked(store, folder, top)
        for steps, files in folders:
            is_within = run is not None and steps[: len(run)] == run
            if not is_within and (files is None or is_run(file.name for file in files)):
                run = steps
                runs.append(RemoteRun(top.joinpath(*steps), files))
    return runs


def _of_objects(store: Any, folder: str) -> Iterator[tuple[Steps, tuple[RemoteFile, ...]]]:
    """A directory and all directories below it, from the names of all objects."""
    folders: dict[Steps, list[RemoteFile]] = {}
    store.invalidate_cache(folder)
    for name, info in store.find(folder, detail=True).items():
        *steps, file = name_below(folder, name).split("/")
        if info["type"] == "file" and all(map(is_plain, [*steps, file])) and not any(s.startswith(".") for s in steps):
            folders.setdefault(tuple(steps), []).append(remote_file(file, info))
    for key, files in sorted(folders.items()):
        yield key, tuple(sorted(files, key=lambda file: file.name))


def _walked(store: Any, top: str, where: RemotePath) -> Iterator[tuple[Steps, tuple[RemoteFile, ...] | None]]:
    """A directory and all directories below it by listing each. Inaccessible directories have None in place of
    files."""
    todo: list[Steps] = [()]
    while todo:
        steps = todo.pop()
        try:
            with explained(where.joinpath(*steps)):
                files, folders = entries(store, "/".join([top.rstrip("/"), *steps]) or "/")
        except StoreLost:
            raise
        except RigError:
            if not steps:
                raise
            if steps[-1] != NO_RUNS:
                yield steps, None
            continue
        yield steps, tuple(files)
        todo += [(*steps, name) for name in reversed(folders) if not name.startswith(".")]
