"""A person's own robot program with its targets corrected in place: a parser a dialect, and one writer of numbers."""
