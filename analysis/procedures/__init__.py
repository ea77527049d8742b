"""The measures, one a file: from tables to figures with their uncertainties. They know no model of the arm's errors."""
