"""An arm with point features before pinhole cameras: exact observations to learn from, and what bounds learning."""
