"""Runs on other computers by URL (`s3://bucket/plant`, `sftp://host/srv/plant`): paths, listings and local copies.

Stores are read through fsspec, an optional extra; the package of each protocol raises different errors, which are
reported in one line. A password in a URL is rejected, because it would appear in process lists, messages and files.
"""

from __future__ import annotations

import errno
import multiprocessing
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from daq.store.durable import TEMPORARY
from daq.store.ledger import LEDGER, to_recover
from daq.store.manifest import MANIFEST, OF_A_RUN
from daq.store.marks import MARKS
from daq.store.run_directory import removed_at_signals
from rigs.calibration import CALIBRATION
from rigs.distribution import to_install
from rigs.errors import CellError, FileError, RigError

Item = TypeVar("Item")
Value = TypeVar("Value")
_URL = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://([^/]*)(.*)", re.DOTALL)
_SLASHED_PASSWORD = re.compile(r"[^/@]*:(?!\d+/)[^@]*@", re.DOTALL)
"""A password that contains a slash, which ends the host name: the part after the colon is not a port."""
_WITHOUT_HOST = ("file", "local")
"""Protocols with no host or bucket in the URL: three slashes follow."""
_WEB = ("http", "https")
if TYPE_CHECKING:
    _Path = Path
else:
    _Path = type(Path())  # Path itself cannot be subclassed before Python 3.12


class RemotePath(_Path):
    """A URL. parts: protocol with a colon, host or bucket, and the names below."""

    def __str__(self) -> str:
        protocol, *names = self.parts or ("",)
        if not protocol.endswith(":"):
            return super().__str__()
        return f"{protocol}//{'/' if self.protocol in _WITHOUT_HOST else ''}{'/'.join(names)}"

    def absolute(self) -> RemotePath:
        return self

    def resolve(self, strict: bool = False) -> RemotePath:
        return self

    @property
    def protocol(self) -> str:
        return self.parts[0][:-1]

    @property
    def top(self) -> str:
        return f"{self.protocol}:///" if self.protocol in _WITHOUT_HOST else f"{self.protocol}://{self.parts[1]}"

    @property
    def steps(self) -> tuple[str, ...]:
        return self.parts[1 if self.protocol in _WITHOUT_HOST else 2 :]


class ImportedRun(_Path):
    """A table of the user in place of a run. run: the temporary run that it was imported to."""

    run: Path

    @classmethod
    def of(cls, table: Path, run: Path) -> ImportedRun:
        made = cls(table)
        made.run = run
        return made

    def __reduce__(self) -> tuple[object, ...]:
        return ImportedRun.of, (Path(str(self)), self.run)

    def absolute(self) -> ImportedRun:
        return self

    def resolve(self, strict: bool = False) -> ImportedRun:
        return self


def location(text: str) -> Path:
    """Parse a local path or a URL. Raises FileError for an unsupported URL."""
    url = _URL.fullmatch(text)
    if "::" in text and "://" in text:
        problem = "contains ::, which fsspec reads as a chain of URLs"
        raise FileError(
            f"{text.partition(':')[0]}:…", problem, "give a single URL, and a computer by name", code="url.form"
        )
    if not url:
        return Path(text)
    protocol, host, names = url[1].lower(), url[2], url[3]
    if ":" in host.rpartition("@")[0] or _SLASHED_PASSWORD.match(host + names):
        remedy = "remove it: credentials are taken from keys, from ~/.aws or from the settings of fsspec"
        raise FileError(
            f"{protocol}://…", "contains a password, which others on this computer can see", remedy, code="url.password"
        )
    if protocol in _WEB and "?" in names:
        raise FileError(
            f"{protocol}://…", "contains a query, and may hold a key", "give the URL of a directory", code="url.query"
        )
    if host and protocol in _WITHOUT_HOST:
        raise FileError(
            text,
            "names a computer, which this protocol does not support",
            f"give three slashes: {protocol}:///DIR",
            code="url.form",
        )
    if not host and protocol not in _WITHOUT_HOST:
        raise FileError(
            text, "names neither a bucket nor a computer", "give one: s3://BUCKET/DIR, sftp://HOST/DIR", code="url.form"
        )
    return RemotePath(f"{protocol}:", host, *names.strip("/").split("/"))


NO_RUNS = "lost+found"
"""A directory at the top of a file system with access for root only."""
_CHUNKS = (".parquet", ".arrow")


def is_run(names: Iterable[str]) -> bool:
    """True if a run has these file names, however damaged. A ledger is sufficient."""
    return not OF_A_RUN.isdisjoint(names)


def has_figures(name: str) -> bool:
    """True if figures depend on a file: marks of exports and protection do not affect them."""
    return name in (MANIFEST, LEDGER) or name.endswith(_CHUNKS)


def is_read(name: str) -> bool:
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
    """Files and subdirectory names of a directory, without links to directories. Raises exceptions of the packages."""
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
    stamp = next((str(info[key]) for key in _STAMPS if info.get(key) is not None), "")
    return RemoteFile(name, int(info["size"]), stamp)


def name_below(folder: str, path: str) -> str:
    """Relative path of a file below a directory, or an empty text if it is elsewhere."""
    start = folder.rstrip("/") + "/"
    path = "/" + path if start.startswith("/") and not path.startswith("/") else path
    return path[len(start) :].rstrip("/") if path.startswith(start) else ""


def is_plain(name: str) -> bool:
    """True if a name is a plain file or directory name; object keys can be any text."""
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
    """Text of an error, without passwords and signatures in URLs."""
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


def listed(top: RemotePath) -> list[RemoteRun]:
    """Runs, and directories that may contain runs, without nested runs."""
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
    folders: dict[Steps, list[RemoteFile]] = {}
    store.invalidate_cache(folder)
    for name, info in store.find(folder, detail=True).items():
        *steps, file = name_below(folder, name).split("/")
        if info["type"] == "file" and all(map(is_plain, [*steps, file])) and not any(s.startswith(".") for s in steps):
            folders.setdefault(tuple(steps), []).append(remote_file(file, info))
    for key, files in sorted(folders.items()):
        yield key, tuple(sorted(files, key=lambda file: file.name))


def _walked(store: Any, top: str, where: RemotePath) -> Iterator[tuple[Steps, tuple[RemoteFile, ...] | None]]:
    """A directory and all directories below it; those that cannot be listed have None in place of files."""
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


_PREFIX = "rig-"
_MORE_ROOM = "set TMPDIR to a directory with more space"
_place: ContextVar[str | None] = ContextVar("place", default=None)


@contextmanager
def fetched(run: Path) -> Iterator[Path]:
    """Provide the directory of a run, copied from its store if it is remote and removed at the end.

    A process has a single copy at a time, so the space of the largest run is enough. Errors in the block name the
    original run or table. Raises RigError if the run cannot be fetched.
    """
    if isinstance(run, RemotePath):
        with _temporary_directory(_place.get()) as name:
            copy = Path(name) / "run"
            _fetch(run, copy)
            with _errors_name(run, copy):
                yield copy
    elif isinstance(run, ImportedRun):
        with _errors_name(run, run.run):
            yield run.run
    else:
        yield run


@contextmanager
def _errors_name(run: Path, copy: Path) -> Iterator[None]:
    try:
        yield
    except RigError as error:
        kind = FileError if isinstance(error, FileError) else CellError
        texts = (error.where, error.what, error.remedy)
        where, what, remedy = (restore_run_path(text, copy, run) for text in texts)
        raise kind(where, what, remedy, code=error.code) from None


def restore_run_path(text: str, copy: Path, run: Path) -> str:
    if copy == run:
        return text
    return text.replace(to_recover(copy), "run `rig recover` on a copy of the run").replace(str(copy), str(run))


@contextmanager
def place_of_copies() -> Iterator[str]:
    """Provide a directory for the copies of several processes, removed at the end, even after SIGTERM or a hang-up.

    Raises CellError if it cannot be created.
    """
    with _temporary_directory(None) as name, removed_at_signals(name, _kill_workers):
        yield name


def fetching_into(place: str, work: Callable[[Item], Value], item: Item) -> Value:
    before = _place.set(place)
    try:
        return work(item)
    finally:
        _place.reset(before)


@contextmanager
def _temporary_directory(within: str | None) -> Iterator[str]:
    try:
        made = tempfile.TemporaryDirectory(prefix=_PREFIX, dir=within)
    except OSError as error:
        raise CellError(
            "TMPDIR", f"a temporary directory cannot be created: {error.strerror}", _MORE_ROOM, code="disk.no_temporary"
        ) from None
    with made as name:
        yield name


def _kill_workers() -> None:
    """Kill the processes that write copies: they would write on to a removed directory."""
    workers = [child for child in multiprocessing.active_children() if child.daemon]
    for worker in workers:
        worker.kill()
    for worker in workers:
        worker.join()


def _fetch(run: RemotePath, into: Path) -> None:
    with explained(run):
        into.mkdir()
        store, folder = opened(run)
        files = [file for file in entries(store, folder)[0] if is_read(file.name)]
        if not files:
            raise FileError(str(run), "contains no run", "give a run or a directory of runs", code="run.missing")
        needed, free = sum(file.size for file in files), shutil.disk_usage(into).free
        if needed > free:
            room = f"{tempfile.gettempdir()} has {free / 1e6:.1f} MB of free space"
            raise CellError(
                str(run), f"has {needed / 1e6:.1f} MB, but the temporary directory {room}", _MORE_ROOM, code="disk.full"
            )
        store.get([f"{folder}/{file.name}" for file in files], [str(into / file.name) for file in files])
        for file in files:
            if (into / file.name).stat().st_size != file.size:
                problem = f"has changed while being read: {file.name} differs from the listing"
                raise FileError(str(run), problem, "repeat this command", code="run.changed")
