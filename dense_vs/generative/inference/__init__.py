"""With a learned model: joints or poses from an image.

May import: what ``kinematics`` may, and ``kinematics``.
"""
