"""Presentation of results for people and scripts: tables, JSON, pictures, reports."""
