"""What the tests drive: the circle, the hemisphere, the ball link, and the robot programs along them."""
