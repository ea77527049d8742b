"""Links to instruments as byte streams: serial ports, TCP and UDP; the loop that runs a conversation; raw captures."""
