"""With a learned model: joints or poses from an image."""
