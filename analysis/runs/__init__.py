"""From recorded runs to tables: times, alignment, whole laps, stops at targets, columns of table files."""
