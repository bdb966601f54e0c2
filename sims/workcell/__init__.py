"""A cell to grasp and insert in: an inaccurate arm, a gripper, parts, rendered cameras with markers."""
