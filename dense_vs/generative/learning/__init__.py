"""From observations to a model: the stages, noise of the states, relearning, and learning online."""
