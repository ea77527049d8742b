"""What all protocols are made of: the conversation and its items, framing, asking, listening. No operating system."""
