"""The dense Kalman filter in PyTorch: ``grid_sample`` for the prediction (14), operations on planes for the update."""

import numpy as np
import torch
from filter_case import FilterNoises


class TorchFilter:
    """State (2 N, H, W) on all cores of the CPU, in PyTorch's usual style: every operation makes a new tensor."""

    def __init__(self, height: int, width: int, joints: int, noises: FilterNoises):
        self.noises = noises
        self.joints = joints
        self.planes = torch.zeros((2 * joints, height, width))
        self.variance_planes = torch.full((joints, height, width), noises.initial_variance)
        rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
        self._places = torch.stack([columns, rows], dim=-1).float()
        self._scale = torch.tensor([2 / (width - 1), 2 / (height - 1)])

    @property
    def jacobian(self) -> np.ndarray:
        """J, ``(H, W, 2, N)``."""
        return self.planes.reshape(2, self.joints, *self.planes.shape[1:]).permute(2, 3, 0, 1).numpy()

    @property
    def variance(self) -> np.ndarray:
        """P, ``(H, W, N)``."""
        return self.variance_planes.permute(1, 2, 0).numpy()

    @torch.inference_mode()
    def update(self, flow: np.ndarray, dq: np.ndarray) -> None:
        """One frame."""
        noises = self.noises
        step = torch.from_numpy(dq)
        height, width = flow.shape[:2]
        by_row = self.planes.view(2, self.joints, height, width)
        u = torch.einsum("cnhw,n->hwc", by_row, step)
        grid = (self._places - u) * self._scale - 1
        moved = torch.nn.functional.grid_sample(
            self.planes[None], grid[None], mode="bilinear", padding_mode="border", align_corners=True
        )[0].view_as(by_row)
        growth = noises.process_noise * float(dq @ dq)
        variance = (self.variance_planes + growth).clamp_(max=noises.max_variance)
        projected = variance * step[:, None, None]
        denominator = torch.einsum("nhw,n->hw", projected, step) + noises.measurement_noise
        error = torch.from_numpy(flow).permute(2, 0, 1) - torch.einsum("cnhw,n->chw", moved, step)
        moved += (error / denominator)[:, None] * projected
        self.variance_planes = variance - projected.square() / denominator
        self.planes = moved.view_as(self.planes)
