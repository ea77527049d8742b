"""Two arms that measure each other: a ball on one flange, a socket on the other, two joint tables, one posterior."""
