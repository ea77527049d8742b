"""The tests: one folder for each folder of the product, and trials of the whole of it."""
