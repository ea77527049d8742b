"""Reading the files of a program, and adding a remark in the syntax of the language."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

from analysis.apps.makers import Maker, maker_of_file, suffixes_in_words
from analysis.apps.makers.program_reader import Remark
from analysis.apps.makers.target import ProgramTexts
from rigs.errors import FileError
from rigs.files import read_bytes

MOST_BYTES = 10_000_000
"""Maximum size of a program: a program with a hundred thousand targets is smaller, and controllers store less."""
ENCODING = "latin-1"
"""Encoding that maps every byte to a character and back, so unchanged text keeps its bytes in any encoding."""
_MOST_BESIDE = 500
"""Maximum number of files in the directory of a program; the backup of a controller contains some hundred."""


def program_texts(path: Path) -> tuple[Maker, dict[str, str]]:
    """Return the maker of a program, and the texts of its files by name, the data list last.

    Raises FileError for a file that is not a program or cannot be read.
    """
    maker = maker_of_file(path)
    if maker is None:
        raise FileError(str(path), "is not a known kind of robot program", f"give a program {suffixes_in_words()}")
    data = maker.files.data
    beside = [path.with_suffix(suffix) for suffix in (data, data.upper(), data.title()) if suffix]
    files = [path, *(file for file in beside if file.exists())][:2]
    texts = {}
    for file in files:
        try:
            content = read_bytes(file, MOST_BYTES)
        except OSError as error:
            raise FileError(str(file), error.strerror or str(error), "check the path and the permissions") from None
        if b"\0" in content:
            remedy = "give the program as ASCII, Latin-1 or UTF-8 text"
            raise FileError(str(file), "is a binary file or UTF-16 text", remedy)
        texts[file.name] = content.decode(ENCODING)
    return maker, texts


def read_program(path: Path) -> tuple[Maker, ProgramTexts]:
    """Return the maker of a program, and the texts of its files and of the other files in the directory.

    The data list is included if it exists. Raises FileError for a file that is not a program, and for a directory with
    too much to read.
    """
    maker, files = program_texts(path)
    suffixes = maker.reader.beside
    others = [
        file
        for file in (sorted(path.resolve().parent.iterdir()) if suffixes else ())
        if file.suffix.lower() in suffixes and file.name not in files and file.is_file()
    ]
    if len(others) > _MOST_BESIDE or sum(file.stat().st_size for file in others) > MOST_BYTES:
        raise FileError(
            str(path.parent),
            f"has more than {_MOST_BESIDE} files, or {MOST_BYTES // 1_000_000} MB, that the program could use",
            "put the program with its files into a separate directory",
        )
    data = {file.name: read_bytes(file, MOST_BYTES) for file in others}
    read_beside = {name: content.decode(ENCODING) for name, content in data.items() if b"\0" not in content}
    return maker, ProgramTexts((*files, *read_beside), (*files.values(), *read_beside.values()), len(files))


MARK = "corrected by rig"
"""Start of the remark in a program corrected by rig. It fits into a remark of every maker."""
_MARKED = re.compile(rf"{MARK}\b", re.IGNORECASE)


def refuse_marked(path: Path) -> None:
    """Raise FileError if a file of the program contains the remark of an earlier correction."""
    for name, text in program_texts(path)[1].items():
        if mark := _MARKED.search(text):
            line = len(re.findall(r"\r\n|\r|\n", text[: mark.start()])) + 1
            problem = "is already corrected by rig; a second correction would add to the first"
            raise FileError(f"{path.with_name(name)}:{line}", problem, "give the original; --anyway corrects anyway")


def mark_of(date: str) -> str:
    """Return the remark for a program corrected on a date."""
    return f"{MARK} on {date}: do not correct twice"


def as_bytes(text: str) -> bytes:
    """Return the bytes of a program's text."""
    return text.encode(ENCODING)


_NUMBERED = re.compile(rb"^[ \t]*(\d+):", re.MULTILINE)


def with_remark(form: Remark, name: str, data: bytes, remark: str) -> bytes:
    """Return the bytes of a program file with an added remark in separate lines."""
    returns = b"\r\n" if b"\r\n" in data else b"\r" if b"\r" in data and b"\n" not in data else b"\n"
    before = form.before.get(Path(name).suffix.lower())
    places = [match.start() for match in before.finditer(data.replace(b"\r", b"\n"))] if before else []
    at = places[-1] if places else len(data)
    number = max([int(match[1][:9]) for match in _NUMBERED.finditer(data[:at].replace(b"\r", b"\n"))], default=0)
    remark_lines = [
        f"{form.begins.format(number + k)}{line}{form.ends}"
        for k, line in enumerate(textwrap.wrap(remark, form.width), start=1)
    ]
    whole = returns.join(line.encode("ascii") for line in remark_lines)
    if at == len(data) and data and not data.endswith((b"\n", b"\r")):
        return data + returns + whole
    return data[:at] + whole + returns + data[at:]
