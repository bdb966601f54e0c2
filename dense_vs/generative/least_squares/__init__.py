"""The pixel error over all unknowns, and its minimization: Levenberg-Marquardt with the Schur complement.

May import: the ground, kernels, and the files of ``generative`` below it (observations, parameters, prediction, report,
rotations).
"""
