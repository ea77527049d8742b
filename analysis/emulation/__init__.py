"""An emulated controller: it reads the programs of five robot languages and drives them, apart from what writes them.

An interpreter reads a program strictly, each from its maker's manual, and moves a `Machine` with it: anything that it
does not know is refused.
"""
