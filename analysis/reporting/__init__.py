"""Results and how people and scripts see them: figures, tables, pictures, reports."""
