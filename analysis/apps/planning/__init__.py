"""Planning of measurements before any run: tests by name, circles that detect missing effects, poses for a tracker."""
