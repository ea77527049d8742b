"""Reading the files of a program, and adding a remark in the syntax of the language."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from pathlib import Path

from analysis.apps.makers import Maker, maker_by, maker_of_file, remedy_for, suffixes_in_words
from analysis.apps.makers.program_reader import Remark
from analysis.apps.makers.target import ProgramTexts
from rigs.errors import FileError, UseError
from rigs.files import read_bytes

MOST_BYTES = 10_000_000
"""Size of a program: one with a hundred thousand targets is smaller, and controllers store less."""
ENCODING = "latin-1"
"""Maps every byte to a character and back, so unchanged text keeps its bytes in any encoding."""
_MOST_FILES = 3000
"""Files of a program and beside it; the backup of a controller contains some hundred."""


def program_texts(path: Path) -> tuple[Maker, dict[str, str]]:
    """Read the files of a program, or of all programs in a directory and below it, by name, the data list last.

    Encoded files of a directory are omitted. Raises FileError.
    """
    maker = _maker_of_directory(path) if path.is_dir() else maker_of_file(path)
    if maker is None:
        raise FileError(str(path), "is not a known kind of robot program", remedy_for(path), code="program.invalid")
    files, data = maker.files, maker.files.data
    if path.is_dir():
        suffixes, is_of_maker = (*files.suffixes, data), maker.reader.is_of_maker
        named = {name: file for name, file in _tree(path, suffixes).items() if not is_of_maker(name)}
    else:
        beside = [path.with_suffix(suffix) for suffix in (data, data.upper(), data.title()) if suffix]
        named = {file.name: file for file in [path, *(file for file in beside if file.exists())][:2]}
    found = {name: _text(file, is_only=not path.is_dir()) for name, file in named.items()}
    texts = {name: text for name, text in found.items() if text is not None}
    if not texts:
        raise _encoded(path)
    return maker, texts


def _text(file: Path, *, is_only: bool) -> str | None:
    """Text of a file, or None if it is encoded. Raises FileError for an encoded file that is the only one."""
    try:
        content = read_bytes(file, MOST_BYTES)
    except OSError as error:
        problem, remedy = error.strerror or str(error), "check the path and the permissions"
        raise FileError(str(file), problem, remedy, code="file.unreadable") from None
    if _is_encoded(content):
        if is_only:
            raise _encoded(file)
        return None
    return content.decode(ENCODING)


def _is_encoded(content: bytes) -> bool:
    """True for content that is no text: binary, encrypted, or UTF-16."""
    return b"\0" in content


def _encoded(path: Path) -> FileError:
    problem, remedy = "is encoded, binary or UTF-16 text", "give the program as ASCII, Latin-1 or UTF-8 text"
    return FileError(str(path), problem, remedy, code="file.invalid")


def _maker_of_directory(path: Path) -> Maker:
    names = {maker.name for file in path.rglob("*") if file.is_file() and (maker := maker_of_file(file))}
    if len(names) != 1:
        problem = f"has programs of {', '.join(sorted(names))}" if names else "has no robot program"
        remedy = f"give a program {suffixes_in_words()}, or a directory of one controller"
        raise FileError(str(path), problem, remedy, code="program.invalid")
    return maker_by(names.pop())


def programs_at(path: Path) -> list[Path]:
    """List the programs at a path. A directory is a single program if its files share data and routines."""
    if not path.is_dir() or (maker := _maker_of_directory(path)).reader.is_together:
        return [path]
    files = list(_tree(path, maker.files.suffixes).values())
    return [file for file in files if not _is_encoded(read_bytes(file, MOST_BYTES))] or files[:1]


def _tree(root: Path, suffixes: Sequence[str], *, deep: bool = True) -> dict[str, Path]:
    """Find the files with any of the suffixes, by their path in the directory. Raises FileError for too many."""
    files = sorted(root.rglob("*") if deep else root.iterdir())
    found = [file for file in files if file.suffix.lower() in suffixes and file.is_file()]
    if len(found) > _MOST_FILES or sum(file.stat().st_size for file in found) > MOST_BYTES:
        problem = f"has more than {_MOST_FILES} files, or {MOST_BYTES // 1_000_000} MB, that the program could use"
        remedy = "put the program with its files into a separate directory"
        raise FileError(str(root), problem, remedy, code="file.too_large")
    return {file.relative_to(root).as_posix(): file for file in found}


def read_program(path: Path, neutral: Sequence[str] = ()) -> tuple[Maker, ProgramTexts]:
    """Read a program and the files that it can use, in its directory or in the backup of the controller around it.

    neutral: routines stated to change nothing. They count as empty, unless a file has their name. Raises UseError if
    the language has no such files, and FileError.
    """
    maker, files = program_texts(path)
    reader, full = maker.reader, path.resolve()
    backup = next((parent for parent in full.parents if re.fullmatch(reader.backup, parent.name.upper())), None)
    root = full if path.is_dir() else backup or full.parent
    own = {full / name if path.is_dir() else full.parent / name for name in files}
    tree = _tree(root, reader.beside, deep=path.is_dir() or backup is not None) if reader.beside else {}
    data = {name: read_bytes(file, MOST_BYTES) for name, file in tree.items() if file not in own}
    read_beside = {name: content.decode(ENCODING) for name, content in data.items() if not _is_encoded(content)}
    if neutral and not reader.empty:
        problem = f"is not possible for {maker.files.label}: a program is a single file"
        raise UseError(f"--neutral {neutral[0]}", problem, "define the function in the program", code="usage")
    stems = {Path(name).stem.upper() for name in (*files, *read_beside)}
    absent = tuple(dict.fromkeys(name for name in neutral if name.upper() not in stems))
    read_beside |= {f"{name}{reader.beside[0]}": reader.empty.format(name) for name in absent}
    texts = (*files.values(), *read_beside.values())
    unread = tuple(name for name in data if name not in read_beside)
    names, is_directory = (*files, *read_beside), path.is_dir()
    return maker, ProgramTexts(
        names, texts, len(files), absent, unread=unread, is_directory=is_directory, tables=_tables(root, reader.tables)
    )


def _tables(root: Path, names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Files of a directory with the tools and frames of the controller."""
    found = sorted(file for file in root.iterdir() if file.name.lower() in names) if names else []
    contents = {file.name: read_bytes(file, MOST_BYTES) for file in found}
    return tuple((name, content.decode(ENCODING)) for name, content in contents.items() if not _is_encoded(content))


MARK, CONVERTED = "corrected by rig", "converted by rig"
"""Starts of the remarks in programs with corrected and with converted points. They fit into a remark of every maker."""
_MARKED = re.compile(rf"{MARK}\b", re.IGNORECASE)
_CONVERTED = re.compile(rf"{CONVERTED}\b", re.IGNORECASE)


def refuse_marked(path: Path) -> None:
    """Raise FileError for a program with computed points that rig has corrected already."""
    problem = "is already corrected by rig; a second correction would add to the first"
    _refuse(path, _MARKED, problem)


def refuse_converted(path: Path, change: str) -> None:
    """Raise FileError for a program with taught points that rig has converted for the same change."""
    text = " ".join(program_texts(path)[1].values())
    if change in text:
        _refuse(path, _CONVERTED, "is already converted by rig for this change; a second conversion would add to it")


def _refuse(path: Path, pattern: re.Pattern[str], problem: str) -> None:
    for name, text in program_texts(path)[1].items():
        if mark := pattern.search(text):
            line = len(re.findall(r"\r\n|\r|\n", text[: mark.start()])) + 1
            file = path / name if path.is_dir() else path.with_name(name)
            remedy = "give the original; --anyway corrects anyway"
            raise FileError(f"{file}:{line}", problem, remedy, code="correction.repeated")


def is_marked(path: Path) -> bool:
    """True if the numbers of a program contain the errors of the arm because rig wrote them."""
    return any(_MARKED.search(text) or _CONVERTED.search(text) for text in program_texts(path)[1].values())


def mark_of(date: str) -> str:
    return f"{MARK} on {date}: do not correct twice"


def converted_mark_of(date: str, change: str) -> str:
    """Remark in a program with converted points. change: digest of the change, which is found again."""
    return f"{CONVERTED} on {date} for change {change}: do not convert twice"


def as_bytes(text: str) -> bytes:
    return text.encode(ENCODING)


_NUMBERED = re.compile(rb"^[ \t]*(\d+):", re.MULTILINE)


def with_remark(form: Remark, name: str, data: bytes, remark: str) -> bytes:
    returns = b"\r\n" if b"\r\n" in data else b"\r" if b"\r" in data and b"\n" not in data else b"\n"
    before = form.before.get(Path(name).suffix.lower())
    places = [match.start() for match in before.finditer(data.replace(b"\r", b"\n"))] if before else []
    at = places[-1] if places else len(data)
    number = max([int(match[1][:9]) for match in _NUMBERED.finditer(data[:at].replace(b"\r", b"\n"))], default=0)
    remark_lines = [
        f"{form.begins.format(number + k)}{line}{form.ends}"
        for k, line in enumerate(textwrap.wrap(remark, form.width), start=1)
    ]
    added = returns.join(line.encode("ascii") for line in remark_lines)
    if at == len(data) and data and not data.endswith((b"\n", b"\r")):
        return data + returns + added
    return data[:at] + added + returns + data[at:]
