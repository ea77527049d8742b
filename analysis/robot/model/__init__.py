"""The forward model: from reported joint angles, through effects in their stages, to what the instruments read."""
