"""Kernels for simulated worlds alone: exact motion, commands, restarts, episodes. Only ``dense_vs.sims`` imports it."""
