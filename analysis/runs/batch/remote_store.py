"""Stores of files elsewhere, through fsspec: what lies in a directory, which of it is a run, and every failure as one
line.

fsspec is an extra, and each protocol has a package of its own, whose errors are of many kinds. They are sorted
here by what a person can do: install something, check the URL, ask for the right to read, or wait for the network.

The runs below a URL are known by listing alone, by the names of their files. An object store lists a thousand objects
in one request, whatever directories their names form, so it is asked once for all; elsewhere each directory is a
request. A process of its own asks: the packages of stores start threads, which a process that forks later must not
have, and one that waits for a store is ended by Ctrl-C at once.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

from analysis.runs.batch.outcomes import Failed
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
"""What a file system puts at its top, for root alone."""
_CHUNKS = (".parquet", ".arrow")


def is_run(names: Iterable[str]) -> bool:
    """Whether files of these names make a directory a run, however damaged: one without a manifest may have its
    ledger."""
    return not OF_A_RUN.isdisjoint(names)


def has_figures(name: str) -> bool:
    """Whether figures follow from a file; marks, which say that a run was exported or is kept, change none."""
    return name in (MANIFEST, LEDGER) or name.endswith(_CHUNKS)


def is_read(name: str) -> bool:
    """Whether reading or verifying a run looks at a file."""
    return has_figures(name) or name == MARKS or name.endswith((TEMPORARY, CALIBRATION))


_PACKAGES = {"s3": "s3fs", "sftp": "sshfs", "ssh": "sshfs"}
"""The packages by which fsspec opens the protocols for which rig has an extra."""
_SSH = ("sftp", "ssh")
_SSH_OPTIONS = {"known_hosts": (), "connect_timeout": 10, "keepalive_interval": 15}
"""Options of asyncssh: host keys are compared with ~/.ssh/known_hosts, which sshfs leaves out by itself; a computer
that does not answer is waited for so many seconds, one that falls silent for three times the interval."""
_STAMPS = ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified", "modified", "created")
"""What a store says of the state of a file, the surest first; the names are those of the packages of fsspec."""
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
"""None is what asyncio gives where several addresses of a computer refuse."""
_LONGEST = 200


class StoreLost(CellError):
    """A store does not answer, so that what follows would fail as well."""


@dataclass(frozen=True)
class RemoteFile:
    """A file in a directory: its name, its bytes, and what changes whenever it changes, empty where nothing does."""

    name: str
    size: int
    stamp: str


@contextmanager
def explained(where: RemotePath) -> Iterator[None]:
    """Whatever a store raises, as a RigError; StoreLost where it does not answer."""
    try:
        yield
    except (RigError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 - every package has errors of its own
        raise _explanation(where, error) from None


def opened(path: RemotePath) -> tuple[Any, str]:
    """The file system of a URL as fsspec has it, and what it calls the path. Raises what the packages raise."""
    import fsspec  # noqa: PLC0415 - an extra

    options: dict[str, Any] = {}
    if path.protocol in _SSH:
        import sshfs  # noqa: F401, PLC0415 - else fsspec takes paramiko, with whatever host key comes

        set_by_person = {key for protocol in _SSH for key in fsspec.config.conf.get(protocol, {})}
        options = {key: value for key, value in _SSH_OPTIONS.items() if key not in set_by_person}
    store, top = fsspec.core.url_to_fs(path.top, **options)
    return store, "/".join([top.rstrip("/"), *path.steps]) or "/"


def entries(store: Any, folder: str) -> tuple[list[RemoteFile], list[str]]:
    """The files in a directory, and the names of the directories in it; links to directories are left out.

    Raises what the packages raise.
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
        with suppress(FileNotFoundError):  # a link that leads nowhere
            info = listed if listed["type"] == "file" and listed.get("size") is not None else store.info(listed["name"])
            files += [remote_file(name, info)] if info["type"] == "file" else []
    return sorted(files, key=lambda file: file.name), sorted(folders)


def remote_file(name: str, info: dict[str, Any]) -> RemoteFile:
    """A file by what its store says of it."""
    stamp = next((str(info[key]) for key in _STAMPS if info.get(key) is not None), "")
    return RemoteFile(name, int(info["size"]), stamp)


def name_below(folder: str, path: str) -> str:
    """The path of a file below a directory; empty for what does not lie below it."""
    start = folder.rstrip("/") + "/"
    path = "/" + path if start.startswith("/") and not path.startswith("/") else path
    return path[len(start) :].rstrip("/") if path.startswith(start) else ""


def is_plain(name: str) -> bool:
    """Whether a name is that of a file or a directory, and leads nowhere else; keys of objects may be any text."""
    return name not in ("", ".", "..") and not {"/", "\\", "\0"} & set(name)


def _explanation(where: RemotePath, error: Exception) -> RigError:
    kinds = {kind.__name__ for kind in type(error).__mro__}
    number = getattr(error, "errno", None)
    message = _reason(error)
    cases: tuple[tuple[bool, type[RigError], str, str], ...] = (
        (
            isinstance(error, ImportError),
            FileError,
            f"needs a package that is not installed: {message}",
            to_install(_PACKAGES[where.protocol]) if where.protocol in _PACKAGES else "install it beside rig",
        ),
        (
            isinstance(error, ValueError) and "Protocol not known" in message,
            FileError,
            "is of a protocol that fsspec does not know",
            "give s3://…, sftp://… or a directory",
        ),
        (
            "HostKeyNotVerifiable" in kinds,
            CellError,
            "the computer's host key is not known",
            "compare its key and accept it once by ssh, so that it stands in ~/.ssh/known_hosts",
        ),
        (
            bool(kinds & _DENIED),
            FileError,
            f"may not be read: {message}",
            "check the credentials, and the right to list and read",
        ),
        (
            isinstance(error, FileNotFoundError | NotADirectoryError),
            FileError,
            "is not there",
            "check the URL: bucket or computer, and directory",
        ),
        (
            number in (errno.ENOSPC, errno.EDQUOT),
            CellError,
            "does not fit into the temporary directory",
            "set TMPDIR to a directory with more room",
        ),
        (
            bool(kinds & _LOST) or (type(error) is OSError and number in _UNREACHABLE),
            StoreLost,
            f"the store does not answer: {message}",
            "check the network and the store, then give this command again",
        ),
        (True, FileError, f"cannot be read: {message}", "check the URL, the store and the settings of fsspec"),
    )
    _, kind, problem, remedy = next(case for case in cases if case[0])
    return kind(str(where), problem, remedy)


def _reason(error: Exception) -> str:
    """The words of an error, without what may be a password or a signature in a URL."""
    words = " ".join((getattr(error, "strerror", None) or str(error)).split()) or type(error).__name__
    words = re.sub(r"(://[^\s?]*)\?[^\s'\"]*", r"\1", re.sub(r"//[^/@\s]*@", "//", words))
    return words[:_LONGEST].rstrip(".")


OBJECT_STORES = ("s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "oss", "oci", "r2")
Steps = tuple[str, ...]
"""The names of a directory below another."""


@dataclass(frozen=True)
class RemoteRun:
    """A run elsewhere; files: in its directory, None where that may not be listed."""

    path: RemotePath
    files: tuple[RemoteFile, ...] | None


def remote_runs(top: RemotePath) -> list[RemoteRun]:
    """The runs below a URL, or the one that it names, in the order of names. Raises RigError."""
    (outcome,) = in_processes(listed, [top], 1)
    if isinstance(outcome, Failed):
        raise outcome.error
    return outcome.value


def listed(top: RemotePath) -> list[RemoteRun]:
    """The same in this process: the directories that are runs or may hold some; none within another run."""
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
    """The directories below another, that itself first, by the names of all objects."""
    folders: dict[Steps, list[RemoteFile]] = {}
    store.invalidate_cache(folder)
    for name, info in store.find(folder, detail=True).items():
        *steps, file = name_below(folder, name).split("/")
        if info["type"] == "file" and all(map(is_plain, [*steps, file])) and not any(s.startswith(".") for s in steps):
            folders.setdefault(tuple(steps), []).append(remote_file(file, info))
    for key, files in sorted(folders.items()):
        yield key, tuple(sorted(files, key=lambda file: file.name))


def _walked(store: Any, top: str, where: RemotePath) -> Iterator[tuple[Steps, tuple[RemoteFile, ...] | None]]:
    """The same, directory by directory; one that may not be listed is given without files."""
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
