"""Setting up: where the circle and the ball are, found from what the robot did."""
