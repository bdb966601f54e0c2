"""What only simulated worlds need: exact motion, commands, restarts, episodes. Only ``dense_vs.sims`` imports it."""
