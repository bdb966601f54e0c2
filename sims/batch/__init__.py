"""Many robots at once on one device: babble, learn, reach, without the host."""
