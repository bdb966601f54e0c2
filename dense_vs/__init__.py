"""Dense visual servoing without calibration."""
