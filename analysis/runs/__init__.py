"""From recorded runs to tables: times, alignment, whole laps, stands at targets, the columns of table files."""
