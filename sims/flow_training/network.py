"""The network behind the flow method "learned": corrects a classical flow where a surface is plain.

A U-Net at half resolution sees the present image, how it differs from the previous one and from the previous one
moved by the initial flow, that flow, and what Lucas and Kanade's equations say about the rest of it: the motion along
the image gradient and in which directions the image has one. Its answer keeps a share of the initial flow at every
pixel, adds to it, and says how far off it expects to be: the scale of a Laplace distribution.
"""

import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

CHANNELS = (16, 32, 64, 96)  # at 1/2, 1/4, 1/8 and 1/16 of the resolution
BLOCKS = (1, 2, 2, 2)  # residual ones, going down; the first is the stem
LARGEST = 16.0  # px, initial flow beyond it is cut


class FlowRefiner(nn.Module):
    """Corrects flow ``(B, 2, H, W)``; H and W are multiples of 16.

    The same weights serve every image size. ``forward`` takes images 0 to 255 as float ``(B, 1, H, W)``: the present
    one, the previous one, and the previous one moved by the initial flow; it returns the flow and ``(B, 1, H, W)``
    log of the scale of its error [log px].
    """

    sobel: Tensor

    def __init__(self, channels: tuple[int, ...] = CHANNELS, blocks: tuple[int, ...] = BLOCKS):
        super().__init__()
        self.stem = convolution(5, channels[0], 5, 2)
        self.stem_gradients = convolution(9, channels[0], 3, 1)
        self.down = nn.ModuleList(convolution(a, b, 3, 2) for a, b in pairwise(channels))
        self.encode = nn.ModuleList(nn.Sequential(*(Residual(c) for _ in range(n)))
                                    for c, n in zip(channels[1:], blocks[1:], strict=True))  # fmt: skip
        self.lateral = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in pairwise(channels))
        self.decode = nn.ModuleList(Residual(c) for c in channels[:-1])
        self.coarse = nn.ModuleList(nn.Conv2d(c, 2, 1) for c in channels[1:])  # only while training
        self.head = nn.Conv2d(channels[0], 16, 3, 1, 1)
        for parameter in self.head.parameters():
            nn.init.zeros_(parameter)
        across = torch.tensor([[-1.0, 0, 1], [-2, 0, 2], [-1, 0, 1]]) / 8
        self.register_buffer("sobel", torch.stack([across, across.T])[:, None], persistent=False)

    def forward(self, present: Tensor, previous: Tensor, moved: Tensor, initial: Tensor) -> tuple[Tensor, Tensor]:
        """Flow and the log of the scale of its error."""
        flow, log_scale, _ = self.all_scales(present, previous, moved, initial)
        return flow, log_scale

    def all_scales(self, present: Tensor, previous: Tensor, moved: Tensor, initial: Tensor) -> tuple:
        """As ``forward``, and coarse flows at 1/16, 1/8 and 1/4 of the resolution [px of the full one]."""
        initial = initial.clamp(-LARGEST, LARGEST)
        seen = torch.cat([present / 64 - 2, (present - previous) / 16, (present - moved) / 16, initial / 2], 1)
        x = functional.relu(self.stem(seen) + self.stem_gradients(self._gradients(present, moved)))
        skips = []
        for down, encode in zip(self.down, self.encode, strict=True):
            skips.append(x)
            x = encode(functional.relu(down(x)))
        coarse = []
        for k in range(len(skips))[::-1]:
            coarse.append(2 * self.coarse[k](x))
            x = self.decode[k](skips[k] + functional.interpolate(self.lateral[k](x), scale_factor=2.0, mode="nearest"))
        answer = functional.pixel_shuffle(self.head(x), 2)
        keep = torch.sigmoid(answer[:, :1] + 2)
        return keep * initial + 2 * answer[:, 1:3], answer[:, 3:] - 1, coarse

    def _gradients(self, present: Tensor, moved: Tensor) -> Tensor:
        """Lucas and Kanade's sums over two windows ``(B, 9, H / 2, W / 2)``: missing motion along the gradient [px],
        direction and size of the gradient."""
        slope = functional.conv2d(functional.pad((present + moved) / 2, (1, 1, 1, 1), mode="replicate"), self.sobel)
        gx, gy = slope[:, :1], slope[:, 1:]
        change = present - moved
        sums = functional.avg_pool2d(torch.cat([gx * gx, gx * gy, gy * gy, gx * change, gy * change], 1), 2)
        wide = functional.avg_pool2d(sums, 7, 1, 3, count_include_pad=False)
        found = []
        for s, floor in ((sums, 4.0), (wide, 1.0)):
            energy = s[:, :1] + s[:, 2:3] + floor
            found += [(-s[:, 3:5] / energy).clamp(-4, 4), (s[:, :1] - s[:, 2:3]) / energy, 2 * s[:, 1:2] / energy]
        return torch.cat([*found, (sums[:, :1] + sums[:, 2:3] + 1).log() / 3 - 1], 1)


def convolution(inputs: int, outputs: int, size: int, stride: int) -> nn.Sequential:
    """Convolution and batch normalization, which become one convolution in the exported network."""
    return nn.Sequential(nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False), nn.BatchNorm2d(outputs))


class Residual(nn.Module):
    """Two convolutions beside the identity."""

    def __init__(self, channels: int):
        super().__init__()
        self.first = convolution(channels, channels, 3, 1)
        self.second = convolution(channels, channels, 3, 1)
        for parameter in list(self.second.parameters())[1:2]:  # scale of the normalization
            nn.init.constant_(parameter, 0.2)

    def forward(self, x: Tensor) -> Tensor:
        """The same size."""
        return functional.relu(x + self.second(functional.relu(self.first(x))))


def warp(image: Tensor, flow: Tensor) -> Tensor:
    """The image ``(B, 1, H, W)`` of a frame ago at the present pixels: its value at x - u(x), borders repeated."""
    H, W = image.shape[2:]
    y = torch.arange(H, device=flow.device)[:, None] - flow[:, 1]
    x = torch.arange(W, device=flow.device) - flow[:, 0]
    grid = torch.stack([2 * x / (W - 1) - 1, 2 * y / (H - 1) - 1], -1)
    return functional.grid_sample(image, grid, padding_mode="border", align_corners=True)


def loss_of(flow: Tensor, log_scale: Tensor, coarse: list[Tensor], true: Tensor, moving: Tensor) -> Tensor:
    """Distance to the true flow over the image's speed, and the Laplace distribution's negative log-likelihood.

    An image counts by how fast its moving pixels are, all of its pixels alike: were each pixel's error relative to
    its own motion, small answers would be favored wherever the motion is in doubt. The likelihood trains the expected
    error and, weakly, what it is estimated from, but not the flow itself.
    """
    distance = ((flow - true) ** 2).sum(1, keepdim=True).add(1e-4).sqrt()
    moving = moving[:, None].float()
    size = true.norm(dim=1, keepdim=True)
    speed = (size * moving).sum((2, 3), keepdim=True) / moving.sum((2, 3), keepdim=True).clamp_min(1)
    weight = (1 + 3 * moving) / (speed + 0.7)
    total = (weight * distance).mean()
    for answer in coarse:
        factor = true.shape[2] // answer.shape[2]
        target, counts = functional.avg_pool2d(true, factor), functional.avg_pool2d(weight, factor)
        total = total + 0.1 * (counts * ((answer - target) ** 2).sum(1, keepdim=True).add(1e-4).sqrt()).mean()
    likelihood = distance.detach() * (-log_scale).exp() + 2 * log_scale
    return total + 0.03 * likelihood.clamp_max(20).mean()


class _Exported(nn.Module):
    """The computation of the shipped file: the flow and the expected error itself [px]."""

    def __init__(self, network: FlowRefiner):
        super().__init__()
        self.network = network

    def forward(self, present: Tensor, previous: Tensor, moved: Tensor, initial: Tensor) -> tuple[Tensor, Tensor]:
        """Flow and expected error."""
        flow, log_scale = self.network(present, previous, moved, initial)
        return flow, 2 * log_scale.exp()  # the mean distance, in two dimensions


def export(network: FlowRefiner, path: str | Path) -> None:
    """Write the network as ONNX for any image size that is a multiple of 16, its weights in half precision."""
    import onnx

    network = network.cpu().eval()
    image, flow = torch.zeros(1, 1, 64, 96), torch.zeros(1, 2, 64, 96)
    names = ["present", "previous", "moved", "initial"]
    sizes = {name: {2: "height", 3: "width"} for name in [*names, "flow", "expected_error"]}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it is the older exporter, and what it does not fold
        torch.onnx.export(
            _Exported(network).eval(), (image, image, image, flow), str(path), input_names=names,
            output_names=["flow", "expected_error"], dynamic_axes=sizes, opset_version=17, dynamo=False,
        )  # fmt: skip
    model = onnx.load(str(path))
    graph, casts = model.graph, []
    for weight in [w for w in graph.initializer if w.data_type == onnx.TensorProto.FLOAT and len(w.dims) == 4]:
        values = onnx.numpy_helper.to_array(weight).astype(np.float16)
        name = weight.name
        weight.CopyFrom(onnx.numpy_helper.from_array(values, f"{name}_half"))
        casts.append(onnx.helper.make_node("Cast", [f"{name}_half"], [name], to=onnx.TensorProto.FLOAT))
    rest = list(graph.node)
    del graph.node[:]
    graph.node.extend(casts + rest)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
