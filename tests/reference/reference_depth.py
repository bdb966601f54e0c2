"""One world of the filter of depth and its row of the image Jacobian, in float64, for images without jumps of depth."""

import numpy as np
from reference_filters import SecondOrderModel, bounded_covariance, kalman
from reference_sampling import moved_image


class ReferenceDepth:
    """State (Z, D, H) of every pixel by plain matrices: Z' = Z + D s + 1/2 s^T H s, D' = D + H s, H' = H."""

    def __init__(self, options, pixels_per_meter, slide):
        self.o = options
        self.second = SecondOrderModel(options.joints)
        curved = len(self.second.pairs) if options.order == 2 else 0
        self.size = 1 + options.joints + curved
        scale = pixels_per_meter**2

        def columns(of_z, of_d, of_h):
            return np.array([of_z] + [of_d / scale] * options.joints + [of_h / scale] * curved)

        self.start = columns(options.depth_noise**2, options.initial_variance, options.initial_hessian_variance)
        self.bound = columns(np.inf, options.initial_variance, options.initial_hessian_variance)
        self.growth = columns(slide**2, options.process_noise, options.hessian_noise)
        self.P = np.diag(self.start)
        self.state = np.zeros((options.height, options.width, self.size))

    def transition(self, dq):
        """F, from Taylor's Z(q + s) = Z + D s + 1/2 s^T H s."""
        F = np.eye(self.size)
        F[0, 1 : 1 + self.o.joints] = dq
        if self.o.order == 2:
            F[1:, 1:] = self.second.transition(dq)
            F[0, 1 + self.o.joints :] = -self.second.observation(dq)[self.o.joints :]
        return F

    def update(self, shift, dq, depth):
        """``shift`` (H, W, 2) is J dq [px] of the frame; ``depth`` (H, W), 0 where unknown, None for a prediction."""
        dq = np.asarray(dq, dtype=np.float64)
        F = self.transition(dq)
        moved = moved_image(self.state, shift, self.o.prediction_iterations)
        known = moved[..., 0] > 0
        self.state = np.where(known[..., None], moved @ F.T, moved)
        self.P = bounded_covariance(F @ self.P @ F.T + np.diag(self.growth * (dq @ dq)), self.bound)
        if depth is None:
            return
        K, self.P = kalman(self.P, np.eye(self.size)[0], self.o.depth_noise**2)
        error = np.where(known & (depth > 0), depth - self.state[..., 0], 0)
        self.state = self.state + error[..., None] * K
        self.state[..., 0] = np.where(~known & (depth > 0), depth, self.state[..., 0])
