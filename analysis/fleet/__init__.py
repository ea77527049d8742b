"""A plant: the robots below one directory, their state and trend, and the catalogue that keeps their figures."""
