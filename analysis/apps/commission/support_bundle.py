"""A zip file with rig file, one short run, findings and versions, for an issue. Personal names are replaced."""

from __future__ import annotations

import getpass
import json
import platform
import re
import socket
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import distributions
from pathlib import Path
from typing import Any, BinaryIO

from daq.store import load_manifest
from daq.store.redacted import redacted_files
from rigs.distribution import version
from rigs.errors import RigError
from rigs.load import find, load, parse

MOST_RUN_BYTES = 20_000_000
"""Largest run in a bundle. Chosen: issue trackers accept attachments of 25 MB."""
_GENERAL = frozenset({"root", "user", "admin", "robot", "rig", "rigd", "operator", "host", "localhost", "cell", "pi"})
"""Names of accounts and computers that identify nobody, and are words of a rig file."""
_FEWEST_LETTERS = 3
_HOMES = re.compile(r"(?:/home|/Users)/[^/\s\"']+|/root(?=/)")
_ADDRESS = re.compile(r"(?<=://)(?P<host>[^/:\s\"'\]]+)")
_LOCAL = re.compile(r"localhost|127\.[0-9.]+|\[::1\]|0\.0\.0\.0")
_MOST_MB = MOST_RUN_BYTES // 1_000_000
_KEPT = "kept: serial numbers of robot and instruments, dates, names of files and runs"


def _is_general(name: str) -> bool:
    return name.lower() in _GENERAL or name.startswith("rig ")  # the operator of runs that rig itself made


@dataclass
class NameReplacement:
    """Replaces home directories, names of users and computers, and network addresses; equal names stay equal."""

    names: Mapping[str, str]
    replaced: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of_this_computer(cls, operators: Sequence[str] = (), hosts: Sequence[str] = ()) -> NameReplacement:
        try:
            users = [getpass.getuser(), *operators]
        except (OSError, KeyError):  # an account without a name
            users = [*operators]
        computers = [socket.gethostname(), socket.gethostname().partition(".")[0], *hosts]
        kinds = [*((name, "user") for name in users), *((name, "host") for name in computers)]
        personal = {name: kind for name, kind in kinds if len(name) >= _FEWEST_LETTERS and not _is_general(name)}
        return cls(dict(sorted(personal.items(), key=lambda item: -len(item[0]))))

    def __call__(self, text: str) -> str:
        text = _HOMES.sub(lambda match: self._kept(match[0], "~"), text)
        text = _ADDRESS.sub(lambda match: self._address(match["host"]), text)
        for name, kind in self.names.items():
            word = rf"(?<![A-Za-z0-9]){re.escape(name)}(?![A-Za-z0-9])"
            if re.search(word, text):
                text = re.sub(word, self._kept(name, kind), text)
        return text

    def _kept(self, name: str, replacement: str) -> str:
        return self.replaced.setdefault(name, replacement)

    def _address(self, host: str) -> str:
        if _LOCAL.fullmatch(host):
            return host
        addresses = sum(by.startswith("address-") for by in self.replaced.values())
        return self.replaced.setdefault(host, f"address-{addresses + 1}")


@dataclass(frozen=True)
class Bundle:
    """Files of a bundle by name, and what its sender must know."""

    files: Mapping[str, bytes]
    packed: tuple[str, ...]
    replaced: tuple[str, ...]
    left_out: tuple[str, ...]

    def lines(self) -> list[str]:
        return [
            f"packed: {'; '.join(self.packed)}",
            f"replaced: {', '.join(self.replaced) or 'nothing'}",
            f"left out: {'; '.join(self.left_out)}",
            _KEPT,
        ]

    def write(self, file: BinaryIO) -> None:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in self.files.items():
                archive.writestr(zipfile.ZipInfo(name, (2000, 1, 1, 0, 0, 0)), data, zipfile.ZIP_DEFLATED)


def newest_run(runs: Path) -> Path | None:
    """Newest run of a directory that fits into a bundle; None if there is none."""
    dated = []
    for path in runs.iterdir() if runs.is_dir() else ():
        try:
            manifest = load_manifest(path)
        except RigError:
            continue
        if manifest.exit_status != "recording" and _size(path) <= MOST_RUN_BYTES:
            dated.append((manifest.started, path))
    return max(dated)[1] if dated else None


def make_bundle(rig_file: str, run: Path | None, runs: Path, findings: Sequence[Mapping[str, Any]]) -> Bundle:
    """Pack a cell. run: the run to include; by default the newest short one in the directory `runs`."""
    path, (rig, text) = find(rig_file), load(rig_file)
    chosen = run or newest_run(runs)
    manifest = load_manifest(chosen) if chosen else None
    hide = NameReplacement.of_this_computer(*(([manifest.operator], [manifest.host]) if manifest else ()))
    hidden_text, name = hide(text), hide(path.name)
    parse(hidden_text, f"{name} without names")
    files = {name: hidden_text.encode(), **rig.companion_files}
    packed = [f"the rig file {' with its calibration' * bool(rig.companion_files)}".rstrip()]
    left_out = ["all other runs, logs, reports and programs"]
    if chosen is None:
        left_out.append(f"a run: {runs} has no run of at most {_MOST_MB} MB; give one with --run")
    elif _size(chosen) > MOST_RUN_BYTES:
        size_mb = _size(chosen) / 1e6
        left_out.append(f"the run {chosen.name}: it has {size_mb:.0f} MB; record one of at most {_MOST_MB} MB")
    else:
        run_name, parts = redacted_files(chosen, hide)
        files |= {f"runs/{run_name}/{part}": data for part, data in parts.items()}
        packed.append(f"the run {run_name}")
    files["findings.json"] = _json(json.loads(hide(json.dumps(findings, ensure_ascii=False, default=str))))
    files["versions.json"] = _json(_versions())
    packed += ["the findings of rig doctor", "versions of rig, its packages and the system"]
    read_me = [f"packed: {'; '.join(packed)}", f"left out: {hide('; '.join(left_out))}", _KEPT, ""]
    return Bundle(
        files | {"README.txt": "\n".join(read_me).encode()}, tuple(packed), tuple(hide.replaced), tuple(left_out)
    )


def _size(run: Path) -> int:
    return sum(file.stat().st_size for file in run.iterdir() if file.is_file())


def _versions() -> dict[str, Any]:
    try:
        system = platform.freedesktop_os_release().get("PRETTY_NAME", "")
    except OSError:
        system = platform.platform(terse=True)
    return {
        "rig": version(),
        "python": platform.python_version(),
        "system": system,
        "kernel": platform.release(),
        "machine": platform.machine(),
        "packages": {one.name: one.version for one in sorted(distributions(), key=lambda one: one.name.lower())},
    }


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1, ensure_ascii=False) + "\n").encode()
