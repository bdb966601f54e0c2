"""Trains the flow network on random scenes: renders on the training device, initial flow by OpenCV on the host.

One thread renders into a ring of pairs, the other trains on random ones of them, so neither waits for the other.
"""

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor, nn

from dense_vs.flow.estimator import METHODS
from dense_vs.sims.flow_training.network import FlowRefiner, loss_of, warp
from dense_vs.sims.flow_training.rendering import Renderer
from dense_vs.sims.flow_training.scenes import Dice
from dense_vs.sims.flow_training.sensor import degrade


@dataclass(frozen=True, kw_only=True)
class TrainingOptions:
    """How long and on what to train.

    Attributes:
        minutes: of training. seed: of scenes and weights. device: of PyTorch.
        height, width: of the images [px], multiples of 16.
        batch: pairs a step. scenes: pairs rendered at once. ring: pairs kept.
        held_out: pairs rendered before training starts; half as many draws from them are what is judged by, and all are
            overwritten. Rendering also goes on while it is ahead of training by no more than so many uses.
        rate: the highest learning rate.
        reuse: how often a pair is trained on before rendering goes on.
        compiled: fuse the ray casting, for a GPU.
    """

    minutes: float = 8.0
    seed: int = 0
    device: str = "cuda"
    height: int = 240
    width: int = 320
    batch: int = 32
    scenes: int = 32
    ring: int = 20000
    held_out: int = 512
    rate: float = 2e-3
    reuse: float = 12.0
    compiled: bool = True


class PairRing:
    """The last pairs rendered, on the training device; filled by a thread."""

    def __init__(self, options: TrainingOptions):
        o, size = options, (options.ring, options.height, options.width)
        self.options, self.filled, self.rendered, self.used = options, 0, 0, 0
        device = torch.device(o.device)
        self.images = [torch.zeros(size, dtype=torch.uint8, device=device) for _ in range(2)]
        self.flows = [torch.zeros(size[0], 2, *size[1:], dtype=torch.float16, device=device) for _ in range(2)]
        self.moving = torch.zeros(size, dtype=torch.bool, device=device)
        self.stop = threading.Event()
        self.failure: BaseException | None = None
        self._dice = Dice(device, 2 * o.seed + 1)
        self._renderer = Renderer(o.height, o.width, compiled=o.compiled)
        self._pool = ThreadPoolExecutor(os.cpu_count() or 1)

    def fill(self) -> None:
        """Render ``scenes`` pairs, degrade them, find their initial flow and store them over the oldest ones."""
        previous, present, true, moving = self.new_pairs()
        initial = initial_flows(self._pool, previous, present)
        n, at = len(true), self.rendered % self.options.ring
        where = (torch.arange(n, device=true.device) + at) % self.options.ring
        for store, new in zip([*self.images, *self.flows, self.moving],
                              [previous, present, true, initial, moving], strict=True):  # fmt: skip
            store[where] = new.to(store.dtype)
        if true.is_cuda:  # written before anyone may look
            torch.cuda.current_stream().synchronize()
        self.rendered += n
        self.filled = min(self.filled + n, self.options.ring)

    def new_pairs(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Previous and present image uint8, true flow, moving pixels; scenes out of the ordinary are left out."""
        with torch.no_grad():
            pairs = self._renderer.pairs(self._dice, self.options.scenes)
            previous, present = degrade(self._dice, pairs.previous, pairs.present)
        usual = (pairs.flow.abs().amax((1, 2, 3)) < 40) & pairs.flow.isfinite().all(3).all(2).all(1)
        return previous[usual], present[usual], pairs.flow[usual], pairs.moving[usual]

    @property
    def wanted(self) -> bool:
        """Whether those rendered so far have been used often enough for new ones."""
        return self.options.reuse * self.rendered <= self.used + self.options.held_out

    def keep_filling(self) -> None:
        """Until stopped; a failure is kept for the training thread."""
        try:
            stream = torch.cuda.Stream() if self.moving.is_cuda else None
            with torch.cuda.stream(stream):
                while not self.stop.is_set():
                    if self.wanted:
                        self.fill()
                    else:
                        time.sleep(0.002)
        except BaseException as error:
            self.failure = error

    def sample(self, count: int) -> tuple[Tensor, ...]:
        """Random pairs, flipped at random: previous, present ``(B, 1, H, W)`` float, true and initial flow, moving."""
        self.used += count
        index = torch.randint(self.filled, (count,), device=self.moving.device)
        images = [store[index][:, None].float() for store in self.images]
        flows = [store[index].float() for store in self.flows]
        moving = self.moving[index]
        for axis in (0, 1):
            flip = torch.rand(count, device=moving.device) < 0.5
            images = [torch.where(flip[:, None, None, None], x.flip(3 - axis), x) for x in images]
            moving = torch.where(flip[:, None, None], moving.flip(2 - axis), moving)
            sign = torch.ones(1, 2, 1, 1, device=moving.device)
            sign[0, axis] = -1
            flows = [torch.where(flip[:, None, None, None], x.flip(3 - axis) * sign, x) for x in flows]
        return *images, *flows, moving


def initial_flows(pool: ThreadPoolExecutor, previous: Tensor, present: Tensor) -> Tensor:
    """``(B, 2, H, W)`` of a batch, one image a thread, from the old places to the new ones."""
    cv2.setNumThreads(1)
    pairs = zip(present.cpu().numpy(), previous.cpu().numpy(), strict=True)
    flows = list(pool.map(lambda pair: METHODS["dis-half"]()(*pair), pairs))
    return -torch.from_numpy(np.stack(flows)).permute(0, 3, 1, 2).to(present.device)


def disturbed(initial: Tensor) -> Tensor:
    """Some initial flows replaced by zero or made worse, so that the network does not trust them blindly."""
    B, device = len(initial), initial.device
    kind = torch.rand(B, 1, 1, 1, device=device)
    coarse = torch.randn(B, 2, 6, 8, device=device) * torch.rand(B, 1, 1, 1, device=device)
    smooth = torch.nn.functional.interpolate(coarse, initial.shape[2:], mode="bilinear", align_corners=True)
    return torch.where(kind < 0.04, torch.zeros_like(initial), torch.where(kind < 0.1, initial + smooth, initial))


class Trainer:
    """Trains a :class:`FlowRefiner`; ``average`` holds the running mean of its weights, which is the result."""

    def __init__(self, options: TrainingOptions, network: FlowRefiner | None = None):
        torch.manual_seed(options.seed)
        self.options = options
        self.device = torch.device(options.device)
        if self.device.type == "cuda":
            torch.backends.cudnn.allow_tf32 = True  # of convolutions alone: poses need every digit
            torch.backends.cudnn.benchmark = True
        self.network = (network or FlowRefiner()).to(self.device)
        # PyTorch's stub does not know this form of the call.
        self.network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]
        self.average = torch.optim.swa_utils.AveragedModel(
            self.network, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(0.999), use_buffers=True
        )
        self.optimizer = torch.optim.AdamW(self.network.parameters(), lr=options.rate, weight_decay=1e-4)
        self.steps = 0

    def step(self, sample: tuple[Tensor, ...], progress: float) -> Tensor:
        """One step on a batch; ``progress`` 0 to 1 sets the learning rate (rise, then a half cosine)."""
        rate = self.options.rate * min(1.0, progress / 0.02 + 0.01) * (0.5 + 0.5 * np.cos(np.pi * min(progress, 1.0)))
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        previous, present, true, initial, moving = sample
        initial = disturbed(initial)
        flow, log_scale, coarse = self.network.all_scales(present, previous, warp(previous, initial), initial)
        total = loss_of(flow, log_scale, coarse, true, moving)
        self.optimizer.zero_grad(set_to_none=True)
        total.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self.optimizer.step()
        self.average.update_parameters(self.network)
        self.steps += 1
        return total.detach()

    def save(self, path: Path) -> None:
        """The averaged weights, for :func:`network.export` or to go on from."""
        torch.save(self.average.module.state_dict(), path)


def score(network: nn.Module, samples: list[tuple[Tensor, ...]]) -> dict[str, float]:
    """Initial and corrected flow on moving pixels: error over motion, a mean of images, and the share of the motion
    that is found (1: none missing on average); on still pixels: error [px]."""
    found: dict[str, list[Tensor]] = {name: [] for name in ("initial", "corrected")}
    network.eval()
    with torch.no_grad():
        for previous, present, true, initial, moving in samples:
            flow, _ = network(present, previous, warp(previous, initial), initial)
            size = true.norm(dim=1)
            fast, still = (moving & (size > 0.3)).float(), (size < 1e-3).float()
            used = fast.sum((1, 2)) > 100
            for name, u in (("initial", initial), ("corrected", flow)):
                error = (u - true).norm(dim=1)
                motion = (size * fast).sum((1, 2)).clamp_min(1)
                relative = (error * fast).sum((1, 2)) / motion
                gain = ((u * true).sum(1) * fast).sum((1, 2)) / (size**2 * fast).sum((1, 2)).clamp_min(1)
                rest = (error * still).sum((1, 2)) / still.sum((1, 2)).clamp_min(1)
                found[name].append(torch.stack([relative.clamp_max(2), gain.clamp(-1, 2), rest])[:, used])
    return {
        f"{name} {part}": float(value)
        for name, parts in found.items()
        for part, value in zip(("error", "gain", "still"), torch.cat(parts, 1).mean(1), strict=True)
    }


def train(
    options: TrainingOptions, out: Path, start: Path | None = None, network: FlowRefiner | None = None
) -> FlowRefiner:
    """Train for ``minutes``; weights go to ``out`` every minute; returns the averaged network."""
    network = network or FlowRefiner()
    if start is not None:
        network.load_state_dict(torch.load(start, map_location="cpu"))
    ring, trainer = PairRing(options), Trainer(options, network)
    while ring.filled < options.held_out:
        ring.fill()
    held_out = [ring.sample(options.batch) for _ in range(max(1, options.held_out // options.batch // 2))]
    ring.filled = ring.rendered = ring.used = 0  # the held-out scenes are overwritten
    ring.fill()
    # A GPU renders beside the training steps. A CPU has nothing to spare for that, and PyTorch's threads, started from
    # two sides at once, would wait for one another.
    beside = trainer.device.type == "cuda"
    filler = threading.Thread(target=ring.keep_filling, daemon=True)
    if beside:
        filler.start()
    began = said = time.monotonic()
    mean, since = 0.0, 0
    while (passed := time.monotonic() - began) < 60 * options.minutes and ring.failure is None:
        if not beside and ring.wanted:
            ring.fill()
        mean += trainer.step(ring.sample(options.batch), passed / (60 * options.minutes))
        since += 1
        if time.monotonic() - said > 20 or since == 1 == trainer.steps:
            said = time.monotonic()
            scores = score(trainer.average.module, held_out).items()
            said_scores = ", ".join(f"{name} {value:.4f}" for name, value in scores)
            done = f"{passed:5.0f} s, step {trainer.steps}, {ring.rendered} pairs, loss {float(mean) / since:.4f}"
            print(f"{done}; {said_scores}", flush=True)
            mean, since = 0.0, 0
            trainer.save(out)
    ring.stop.set()
    if beside:
        filler.join()
    if ring.failure is not None:
        raise ring.failure
    trainer.save(out)
    print("held out:", score(trainer.average.module, held_out), flush=True)
    network.load_state_dict(trainer.average.module.state_dict())
    return network
