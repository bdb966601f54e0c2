"""Simulated masks of approached objects, which the learned depth is trained on."""
