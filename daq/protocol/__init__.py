"""Building blocks of all protocols: conversations, items, framing, polling and listening.

Independent of the operating system.
"""
