"""The tests of the paper, one a file: from aligned data to the figures that are reported."""
