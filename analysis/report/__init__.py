"""How people and scripts see results: tables, JSON, pictures, reports."""
