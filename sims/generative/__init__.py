"""Evidence for the generative model: simulated arms, cameras and features with exact truth, and a cell to work in."""
