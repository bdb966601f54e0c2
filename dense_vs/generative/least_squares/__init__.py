"""The pixel error over all unknowns, and its minimization: Levenberg-Marquardt with the Schur complement."""
