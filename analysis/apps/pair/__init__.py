"""Joint calibration of two arms that hold a ball and a socket, from their joint angles when the ball is seated."""
