"""Dense optical flow between two images, of one camera or of many worlds at once.

May import: the ground and kernels.
"""

from dense_vs.flow.batch_flow import BatchFlow
from dense_vs.flow.estimator import METHODS, FlowEstimator, to_gray

__all__ = ["METHODS", "BatchFlow", "FlowEstimator", "to_gray"]
