"""What tests and the scripts for developers share, imported as `tests.support.NAME`."""
