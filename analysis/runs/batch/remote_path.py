"""Remote runs and directories by URL: `s3://bucket/plant`, `sftp://host/srv/plant`.

Commands treat a URL like a path, so this is a path class with the URL as text. It does not access files:
`analysis.runs.batch.fetched` does. A password in a URL is rejected, because it would appear in process lists, messages
and files.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from rigs.errors import FileError

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
        """URL, or the names of a relative path."""
        protocol, *names = self.parts or ("",)
        if not protocol.endswith(":"):
            return super().__str__()
        return f"{protocol}//{'/' if self.protocol in _WITHOUT_HOST else ''}{'/'.join(names)}"

    def absolute(self) -> RemotePath:
        """Path itself, which does not depend on the current directory."""
        return self

    def resolve(self, strict: bool = False) -> RemotePath:
        """Path itself: links are not followed."""
        return self

    @property
    def protocol(self) -> str:
        """The protocol, for example `s3`."""
        return self.parts[0][:-1]

    @property
    def top(self) -> str:
        """The URL of the host or bucket."""
        return f"{self.protocol}:///" if self.protocol in _WITHOUT_HOST else f"{self.protocol}://{self.parts[1]}"

    @property
    def steps(self) -> tuple[str, ...]:
        """The names below `top`."""
        return self.parts[1 if self.protocol in _WITHOUT_HOST else 2 :]


class ImportedRun(_Path):
    """A table of the user in place of a run. run: the temporary run that it was imported to."""

    run: Path

    @classmethod
    def of(cls, table: Path, run: Path) -> ImportedRun:
        """Table with its temporary run."""
        made = cls(table)
        made.run = run
        return made

    def __reduce__(self) -> tuple[object, ...]:
        """Support pickling for the workers of several runs."""
        return ImportedRun.of, (Path(str(self)), self.run)

    def absolute(self) -> ImportedRun:
        """Path itself, so that messages name the table as the user does."""
        return self

    def resolve(self, strict: bool = False) -> ImportedRun:
        """Path itself."""
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
