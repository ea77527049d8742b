"""The real world of the trial: cells as noisy as real ones, and arms that have a little of everything at full size."""
