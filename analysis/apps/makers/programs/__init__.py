"""Robot programs of the tests: motion plans independent of a language, the checks on them, and common parts of the
writers."""
