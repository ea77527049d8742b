"""The makers of robot controllers, a folder each, and what is asked of them; nothing else names one. Each answer is a
value of the maker's folder, read when it is asked for:

- `__init__.py`: FILES, the files of a program, and CONTROLLER, where zeros of joints and constants of links are held;
- `writer.py`: WRITER, how the programs of a test are written;
- `reader.py`: READER, what is understood of a person's own program, so that its targets can be corrected in place;
- `driver.py`: DRIVER, how an emulated controller drives a program, and what a person can enter there.

Writer, reader and driver are written apart from each other, each from the maker's manual, since each is tried by the
others. Where a maker lacks an answer, who asks for it is refused.

A correction says that at an unchanged posture a joint must read `add_deg` more. Each maker's controller computes its
reading in its own way, and from that the change of its parameter follows. Where the direction in which a maker counts a
length is not public, the growth of the length is stated, with the size that must stand there before it is changed.
Counts per degree and gear ratios belong to each axis of each model, with the sign of its motor; they are not public for
all, so a person gives them. Without them a change is stated in degrees of the reading.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar

from rigs.errors import UseError
from rigs.schema.vocabulary import MAKERS, MakerName, makers, offered_makers

if TYPE_CHECKING:
    from analysis.apps.makers.emulated import ProgramDriver
    from analysis.apps.makers.program_reader import ProgramReader
    from analysis.apps.makers.program_writer import ProgramWriter

T = TypeVar("T")


@dataclass(frozen=True)
class ProgramFiles:
    """The files of a program: the suffixes of the one with the motion, in lower case, and that of its data list beside
    it; label: the maker in a few letters; ending: what the file's name has more than the program's."""

    label: str
    suffixes: tuple[str, ...]
    data: str = ""
    ending: str = ""


@dataclass(frozen=True)
class ConstantParameter:
    """The parameter of a link constant: `key` as in the rig file, `name` and `unit` at the controller, and its change
    `per_unit` for a mm or degree. `later` is by how many axes the rig file has the constant later: Craig's a and alpha
    stand at the axis after the link. `axes` are those of the rig file that have it, from 1. `by_size` states that the
    direction in which the maker counts the length is not public: the length grows, whichever sign it is written with,
    and a length of zero has no parameter."""

    key: str
    name: str
    unit: str
    per_unit: float
    later: int = 0
    axes: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    by_size: bool = False

    def of(self, axis: int) -> str:
        """Return its name for an axis of the rig file."""
        return self.name.format(axis=axis - self.later)


@dataclass(frozen=True)
class Controller:
    """How one maker's controller holds zeros and constants.

    `zero` names the parameter of the zero of axis {axis}; one degree more of the reading changes it by `per_deg` of
    `unit`, times the axis' scale where `scale` says what that is. `changes_reading` states whether the reading of a
    joint changes, or only the arm's model. `steps` are for the person at the controller; `source` is public, and
    `missing` says what was not found, `place` where a person enters the values. A source marked (W) is no manual of the
    maker.
    """

    maker: str
    place: str
    zero: str
    unit: str
    per_deg: float
    scale: str
    steps: tuple[str, ...]
    source: str
    missing: str
    changes_reading: bool = True
    constants: tuple[ConstantParameter, ...] = ()

    @property
    def check(self) -> str:
        """What proves that a value was entered with the right sign, before the robot moves."""
        return _CHECK_READING if self.changes_reading else f"{_CHECK_MODEL} If not, restore {self.place}."


_CHECK_READING = (
    "Check before any motion, since no real controller has tested these signs: at an unchanged posture every corrected "
    "axis must now read the degrees above more than before, and no other axis anything else. If not, enter the old "
    "value again."
)
_CHECK_MODEL = (
    "Check before any motion, since no real controller has tested these signs: the joint angles on the pendant must be "
    "those of before; the position of the tool changes."
)

CHECK_LENGTH = (
    "Check each length before it is changed: the controller's value must be the one given as now, whichever its "
    "sign, and the new one is longer for + and shorter for -. If another value stands there, leave it and hold the "
    "rest by corrected targets."
)
LATER = (2, 3, 4, 5, 6)
"""Axes of the rig file with a link before them that is the controller's."""


@dataclass(frozen=True)
class _Answer(Generic[T]):
    """A value at a place in a maker's package, as "writer.WRITER", and what it means that there is none."""

    place: str
    lacking: str

    def __get__(self, maker: Maker, owner: type[Maker]) -> T:
        """Return the value. Raises UseError where the package has none, or one that cannot be used."""
        place = f"{maker.package}.{self.place}"
        module, _, name = place.rpartition(".")
        try:
            answer: T = getattr(import_module(module), name)
        except Exception as error:
            if isinstance(error, AttributeError | ModuleNotFoundError) and error.name in (module, name):
                raise UseError(
                    maker.name, self.lacking, f"choose a different maker, or add {place} to the package"
                ) from None
            if maker.name in MAKERS:
                raise
            raise UseError(maker.name, f"{module} cannot be used: {error}", f"correct {maker.package}") from error
        return answer


@dataclass(frozen=True)
class Maker:
    """A maker by its name and the package with its answers."""

    name: MakerName
    package: str
    files: ClassVar[_Answer[ProgramFiles]] = _Answer("FILES", "the files of the programs are unknown")
    controller: ClassVar[_Answer[Controller]] = _Answer(
        "CONTROLLER", "the place of zeros and lengths in this controller is unknown"
    )
    writer: ClassVar[_Answer[ProgramWriter]] = _Answer("writer.WRITER", "rig does not write programs for this maker")
    reader: ClassVar[_Answer[ProgramReader]] = _Answer("reader.READER", "rig does not read programs of this maker")
    driver: ClassVar[_Answer[ProgramDriver]] = _Answer(
        "driver.DRIVER", "rig does not emulate controllers of this maker"
    )


def maker_by(name: MakerName) -> Maker:
    """Return a maker by its name. Raises UseError for one that neither rig nor another package has."""
    package = f"analysis.apps.makers.{name}" if name in MAKERS else offered_makers().get(name)
    if package is None:
        raise UseError(name, "is not a known maker of controllers", f"give one of {', '.join(makers())}")
    return Maker(name, package)


def maker_of_file(name: str | Path) -> Maker | None:
    """Return the maker whose controllers drive a file, by its suffix; None for a file without motion."""
    suffix = Path(name).suffix.lower()
    for maker in map(maker_by, makers()):
        with suppress(UseError):  # one of another package that cannot be used has no files
            if suffix in maker.files.suffixes:
                return maker
    return None


def suffixes_in_words() -> str:
    """Return the suffixes of programs of rig's own makers, each with its maker."""
    every = [maker_by(name).files for name in MAKERS]
    *first, last = (
        f"{' or '.join(files.suffixes)}{f' with its {files.data}' * bool(files.data)} ({files.label})"
        for files in every
    )
    return f"{', '.join(first)} or {last}"
