"""Random jointed arms with exact flow, and the training of the flow network on them.

May import: the ground, the algorithms, PyTorch.
"""
