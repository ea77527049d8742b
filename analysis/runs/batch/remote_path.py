"""Runs and directories that lie elsewhere, by their URL: `s3://bucket/plant`, `sftp://host/srv/plant`.

A URL goes through the same commands as a path, so it is a path here, whose text is the URL. It names what is read,
and opens nothing: files are fetched by `analysis.runs.batch.fetched`. A password in a URL would stand in the list of
processes, in messages and in files, so that none is taken.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from rigs.errors import FileError

_URL = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://([^/]*)(.*)", re.DOTALL)
_SLASHED_PASSWORD = re.compile(r"[^/@]*:(?!\d+/)[^@]*@", re.DOTALL)
"""One that holds a slash, which ends the computer's name: what follows its colon is no port."""
_WITHOUT_HOST = ("file", "local")
"""Protocols whose URLs name no computer and no bucket: three slashes follow."""
_WEB = ("http", "https")
if TYPE_CHECKING:
    _Path = Path
else:
    _Path = type(Path())  # Path itself cannot be extended before Python 3.12


class RemotePath(_Path):
    """A URL; its parts are the protocol with its colon, the computer or bucket, and the names below it."""

    def __str__(self) -> str:
        """The URL; of what is relative to another one, its names."""
        protocol, *names = self.parts or ("",)
        if not protocol.endswith(":"):
            return super().__str__()
        return f"{protocol}//{'/' if self.protocol in _WITHOUT_HOST else ''}{'/'.join(names)}"

    def absolute(self) -> RemotePath:
        """Itself: it depends on no current directory."""
        return self

    def resolve(self, strict: bool = False) -> RemotePath:
        """Itself: links are not followed."""
        return self

    @property
    def protocol(self) -> str:
        """As `s3`."""
        return self.parts[0][:-1]

    @property
    def top(self) -> str:
        """The URL of its computer or bucket."""
        return f"{self.protocol}:///" if self.protocol in _WITHOUT_HOST else f"{self.protocol}://{self.parts[1]}"

    @property
    def steps(self) -> tuple[str, ...]:
        """The names below that."""
        return self.parts[1 if self.protocol in _WITHOUT_HOST else 2 :]


def location(text: str) -> Path:
    """What a person named: a path of this computer, or a URL. Raises FileError for a URL that cannot be taken."""
    url = _URL.fullmatch(text)
    if "::" in text and "://" in text:
        problem = "holds ::, which fsspec takes for a chain of URLs"
        raise FileError(f"{text.partition(':')[0]}:…", problem, "give one URL, and a computer by its name")
    if not url:
        return Path(text)
    protocol, host, names = url[1].lower(), url[2], url[3]
    if ":" in host.rpartition("@")[0] or _SLASHED_PASSWORD.match(host + names):
        remedy = "leave it out: credentials are taken from keys, from ~/.aws or from the settings of fsspec"
        raise FileError(f"{protocol}://…", "holds a password, which others on this computer can see", remedy)
    if protocol in _WEB and "?" in names:
        raise FileError(f"{protocol}://…", "holds a query, and may hold a key", "give the URL of a directory")
    if host and protocol in _WITHOUT_HOST:
        raise FileError(text, "names a computer, which this protocol cannot", f"give three slashes: {protocol}:///DIR")
    if not host and protocol not in _WITHOUT_HOST:
        raise FileError(text, "names no bucket and no computer", "give one: s3://BUCKET/DIR, sftp://HOST/DIR")
    return RemotePath(f"{protocol}:", host, *names.strip("/").split("/"))
