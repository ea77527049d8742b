"""Acme, a maker that there is not: programs of a line an instruction, and zeros in degrees."""

from analysis.apps.makers import Controller, ProgramFiles

FILES = ProgramFiles("Acme", (".acm",))
CONTROLLER = Controller(
    "Acme",
    "the page Zeros",
    "zero of axis {axis}",
    "deg",
    -1.0,
    "",
    ("Change the zeros on the page Zeros, in service mode.",),
    "the maker's manual, page 1: an axis reads the angle of its motor less its zero",
    "parameters for link constants: corrected targets are the way to the rest",
)
