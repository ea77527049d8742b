"""Robot programs of the tests: a plan of motion that knows no dialect, what it asks of the arm, a writer a dialect."""
