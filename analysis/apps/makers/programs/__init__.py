"""Robot programs of the tests: a plan of motion that knows no language, what it asks of the arm, what writers share."""
