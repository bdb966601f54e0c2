"""Training of the learned depth: simulated masks of approached objects, and the fit of the network to them."""
