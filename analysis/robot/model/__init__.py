"""Forward model: from reported joint angles, through effects in stages, to instrument readings."""
