"""Geometry of the tests: circle, hemisphere, ball link, ISO cube, and the robot programs along them."""
