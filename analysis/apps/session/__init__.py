"""A guided session: what is driven, recorded, found, corrected and driven again, kept in one file."""
