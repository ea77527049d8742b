"""Reading a rig file: found by path or by name, read whole, every mistake told at once."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ValidationError

from rigs.effects import Effect
from rigs.errors import FileError
from rigs.problems import RigFileError, problems_of
from rigs.rig import Rig
from rigs.yaml_text import read_yaml

SHIPPED = Path(__file__).parent
_MAX_BYTES = 1_000_000


class _Effects(BaseModel):
    """The part of a rig file that `rig simulate --effects` takes."""

    effects: tuple[Effect, ...] | None = None


def find(name: str | Path) -> Path:
    """A rig file by path, or a shipped one by name (`paper-fanuc`). Raises FileError with what is shipped."""
    path = Path(name)
    try:
        if path.exists() and not path.is_dir():
            return path
    except OSError as error:
        raise _unreadable(path, error) from None
    shipped = {file.stem: file for file in sorted(SHIPPED.glob("*.yaml"))}
    if str(name) in shipped:
        return shipped[str(name)]
    raise FileError(str(name), "no such rig file", f"give a path, or a shipped rig: {', '.join(shipped)}")


def load(name: str | Path) -> tuple[Rig, str]:
    """A rig and the text of its file as it is. Raises FileError or RigFileError."""
    path = find(name)
    text = _text(path)
    return parse(text, str(path)), text


def _text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            data = file.read(_MAX_BYTES + 1)
    except OSError as error:
        raise _unreadable(path, error) from None
    if len(data) > _MAX_BYTES:
        raise FileError(str(path), "larger than 1 MB, which no rig file is", "give the rig file itself")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise FileError(str(path), f"not UTF-8 at byte {error.start}", "save it as UTF-8") from None


def _unreadable(path: Path, error: OSError) -> FileError:
    return FileError(str(path), error.strerror or str(error), "check the path and its permissions")


def parse(text: str, where: str) -> Rig:
    """A rig from the text of its file; `where` names it in errors. Raises RigFileError."""
    # The runs of a day bear the same text, and reading it takes longer than reading their data.
    if text not in _good:
        while len(_good) >= _MOST_KEPT:
            del _good[next(iter(_good))]
        _good[text] = _parsed(text, where)
    return _good[text]


_good: dict[str, Rig] = {}
_MOST_KEPT = 16


def _parsed(text: str, where: str) -> Rig:
    root, data = read_yaml(text, where)
    try:
        return Rig.model_validate(data)
    except ValidationError as error:
        raise RigFileError(where, problems_of(error, data, root)) from None


def load_effects(path: Path) -> tuple[Effect, ...]:
    """The effects of a rig file, or of a file with nothing but `effects:`. Raises FileError or RigFileError."""
    root, data = read_yaml(_text(path), str(path))
    if isinstance(data, list):
        data = {"effects": data}
    if not isinstance(data, dict) or not {"effects", "robot"} & data.keys():
        # A misspelt key would else be a robot without errors, and nobody would know.
        raise FileError(str(path), "has no key effects", "write effects: [{effect: …}], or effects: [] for none")
    try:
        return _Effects.model_validate(data).effects or ()
    except ValidationError as error:
        raise RigFileError(str(path), problems_of(error, data, root, _Effects)) from None
