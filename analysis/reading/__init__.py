"""From runs and files to tables: times, alignment, stands at targets, columns."""
