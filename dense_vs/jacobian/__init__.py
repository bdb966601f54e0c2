"""The dense image Jacobian: its filter, DIJE (9) to (14), and how far an estimate is from the truth.

May import: the ground and kernels.
"""

from dense_vs.jacobian.error import JacobianError, jacobian_error
from dense_vs.jacobian.estimator import DenseJacobian
from dense_vs.jacobian.options import JacobianOptions

__all__ = ["DenseJacobian", "JacobianError", "JacobianOptions", "jacobian_error"]
