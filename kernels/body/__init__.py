"""Labels of the robot's own body: clusters of J, and how much of the motion joints explain."""
