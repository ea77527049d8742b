"""Evaluation of the tests, one per file: from tables to figures with uncertainties, independent of error models."""
