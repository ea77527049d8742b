"""The forward model: programs, effects in their stages, and what the instruments read."""
