"""Building blocks of all protocols: conversations and items, framing, polling, listening. No operating system."""
