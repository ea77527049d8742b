"""Links to instruments as byte streams (serial, TCP, UDP), the conversation loop, and raw captures."""
