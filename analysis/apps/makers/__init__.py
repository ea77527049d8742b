"""The makers of robot controllers: a folder per maker, and the common interface. No other module names a maker.

The folder of a maker contains these values, imported on first use:

- `__init__.py`: FILES, the files of a program, and CONTROLLER, the parameters for zeros and constants of links;
- `writer.py`: WRITER, which writes the programs of a test;
- `reader.py`: READER, which parses a user's program, so that targets can be corrected in place;
- `driver.py`: DRIVER, an emulated controller that executes a program, with the parameters an operator can enter.

Writer, reader and driver are independent implementations of the maker's manual, because the tests compare them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar

from rigs.errors import UseError
from rigs.makers import MAKERS, PACKAGES
from rigs.schema.vocabulary import MakerName
from rigs.text import enumerated

if TYPE_CHECKING:
    from analysis.apps.makers.emulated import ProgramDriver
    from analysis.apps.makers.program_reader import ProgramReader
    from analysis.apps.makers.program_writer import ProgramWriter
    from rigs.rig import Rig

T = TypeVar("T")


@dataclass(frozen=True)
class ProgramFiles:
    label: str
    suffixes: tuple[str, ...]
    """Of the file with the motion, in lower case."""
    data: str = ""
    """Suffix of the data list in the same directory."""
    ending: str = ""
    """Text added to the name of the program in the file name."""
    unread: str = ""
    """Suffix of a form that rig does not read, if the controller also writes the program as text."""


@dataclass(frozen=True)
class ConstantParameter:
    key: str
    name: str
    unit: str
    per_unit: float
    """Change of the parameter per mm or degree."""
    later: int = 0
    """Axis number in the rig file minus that at the controller: Craig's a and alpha belong to the next axis."""
    axes: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    by_size: bool = False
    """True if the sign of a length is not public: its growth is stated, and a zero length has no parameter."""

    def of(self, axis: int) -> str:
        return self.name.format(axis=axis - self.later)


@dataclass(frozen=True)
class Controller:
    """Zeros and constants in the controllers of a maker.

    Each additional degree of the reading changes the zero by `per_deg` of `unit`, times the scale of the axis, if any.
    """

    maker: str
    place: str
    """Menu or file in which the operator enters the values."""
    zero: str
    unit: str
    per_deg: float
    scale: str
    steps: tuple[str, ...]
    source: str
    """Public reference; (W) marks references other than a manual of the maker."""
    missing: str
    changes_reading: bool = True
    """False if only the model of the arm changes."""
    constants: tuple[ConstantParameter, ...] = ()
    first_joint: int = 1
    signs_tested: bool = False
    """True if the values were entered in a real controller."""
    files: Callable[[Rig, Mapping[tuple[int, str], float]], dict[str, str]] | None = None
    """Texts by name that enter changes, by axis and key, into a controller of a rig."""

    def zero_of(self, axis: int) -> str:
        return self.zero.format(axis=axis - 1 + self.first_joint)

    @property
    def check(self) -> str:
        check = _CHECK_READING if self.changes_reading else f"{_CHECK_MODEL} If not, restore {self.place}."
        return check.replace(_UNTESTED, "") if self.signs_tested else check


_UNTESTED = ", because these signs were not tested on a real controller"
_CHECK_READING = (
    f"Check before any motion{_UNTESTED}: at an unchanged posture the readings must have increased by the degrees "
    "above, and all other readings must be unchanged. Otherwise, restore the old value."
)
_CHECK_MODEL = (
    f"Check before any motion{_UNTESTED}: the joint angles on the pendant must be unchanged; the tool position changes."
)

CHECK_LENGTH = (
    "Before changing a length, check that the controller has the value given as now, with either sign; "
    "the new value is longer for + and shorter for -. If the controller has a different value, do not "
    "change the length, and correct the rest with corrected targets."
)
LATER = (2, 3, 4, 5, 6)
"""Axes of the rig file that have a parameter, if the controller numbers a link by the axis before it."""


@dataclass(frozen=True)
class _PackageValue(Generic[T]):
    """A value in the package of a maker, as "writer.WRITER", imported on first use."""

    place: str
    lacking: str

    def __get__(self, maker: Maker, owner: type[Maker]) -> T:
        """Import the value. Raises UseError if it is missing or cannot be imported."""
        place = f"{maker.package}.{self.place}"
        module, _, name = place.rpartition(".")
        try:
            answer: T = getattr(import_module(module), name)
        except Exception as error:
            if isinstance(error, AttributeError | ModuleNotFoundError) and error.name in (module, name):
                raise UseError(
                    maker.name,
                    self.lacking,
                    f"choose a different maker, or add {place} to the package",
                    code="maker.unknown",
                ) from None
            if place.startswith(f"{__name__}."):  # a defect of rig, not of an installed package
                raise
            raise UseError(
                maker.name, f"{module} cannot be used: {error}", f"correct {maker.package}", code="package.missing"
            ) from error
        return answer


@dataclass(frozen=True)
class Maker:
    name: MakerName
    package: str
    files: ClassVar[_PackageValue[ProgramFiles]] = _PackageValue("FILES", "the files of the programs are unknown")
    controller: ClassVar[_PackageValue[Controller]] = _PackageValue(
        "CONTROLLER", "the place of zeros and lengths in this controller is unknown"
    )
    writer: ClassVar[_PackageValue[ProgramWriter]] = _PackageValue(
        "writer.WRITER", "rig does not write programs for this maker"
    )
    reader: ClassVar[_PackageValue[ProgramReader]] = _PackageValue(
        "reader.READER", "rig does not read programs of this maker"
    )
    driver: ClassVar[_PackageValue[ProgramDriver]] = _PackageValue(
        "driver.DRIVER", "rig does not emulate controllers of this maker"
    )


def maker_by(name: MakerName) -> Maker:
    """Raises UseError if neither rig nor an installed package provides the maker."""
    if name not in PACKAGES:
        raise UseError(
            name, "is not a known maker of controllers", f"choose from {', '.join(MAKERS)}", code="maker.unknown"
        )
    return Maker(name, PACKAGES[name])


def maker_of_file(name: str | Path) -> Maker | None:
    """Find the maker by the suffix of a file; None if it is no robot program."""
    suffix = Path(name).suffix.lower()
    return next((maker for maker, files in _makers_with_files() if suffix in files.suffixes), None)


def _makers_with_files() -> Iterator[tuple[Maker, ProgramFiles]]:
    for maker in map(maker_by, MAKERS):
        with suppress(UseError):  # An external package that cannot be imported has no files.
            yield maker, maker.files


def remedy_for(name: str | Path) -> str:
    suffix = Path(name).suffix.lower()
    for _, files in _makers_with_files():
        if suffix and suffix == files.unread:
            return f"give the same program as {files.suffixes[0]}, which the controller ({files.label}) writes as text"
    return f"give a program {suffixes_in_words()}"


def suffixes_in_words() -> str:
    written = [
        f"{' or '.join(files.suffixes)}{f' with its {files.data}' * bool(files.data)} ({files.label})"
        for _, files in _makers_with_files()
    ]
    return enumerated(written, "or")
