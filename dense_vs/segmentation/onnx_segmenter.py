"""A user's neural network for video object segmentation as a segmenter, run by ONNX Runtime.

Covers networks that take one image, and recurrent ones that take the mask of the frame before or hidden states and
return them for the next frame. What an image looks like to the network (layout, order of colors, normalization, size)
and what its answer means (logits, probabilities, one channel a class) are options, as no file tells them.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np

from dense_vs.arrays import number_array
from dense_vs.checks import check_choice, check_number, check_pair, check_whole
from dense_vs.errors import DenseVSError
from dense_vs.files import input_file
from dense_vs.segmentation.segmenter import check_image, check_mask

Layout = Literal["nchw", "nhwc"]
Colors = Literal["rgb", "bgr"]
Activation = Literal["logit", "probability", "class_logits", "class_probabilities", "labels"]

MOST_BYTES = 2 << 30  # of a network file; the format has no larger ones
_TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
    "tensor(int64)": np.int64,
    "tensor(int32)": np.int32,
    "tensor(bool)": np.bool_,
}


@dataclass(frozen=True, kw_only=True)
class OnnxOptions:
    """Input that the network expects, and output that it returns.

    Attributes:
        layout: ``"nchw"`` or ``"nhwc"``, of the image and of the answer.
        colors: ``"rgb"`` or ``"bgr"``, order of the channels.
        size: (height, width) that images are resized to; None takes the network's own, or the image's where
            the network leaves it open.
        multiple: where the size is open, sides are rounded up to a multiple of this.
        scale: pixel values are multiplied by this first: 1/255 for networks that expect 0 to 1.
        mean, std: subtracted and divided by after that, a number a channel.
        image_input: name of the image's input; None takes the only one that is not in ``states`` or ``mask_input``.
        mask_output: name of the answer; None takes the first that is not a state.
        activation: ``"logit"`` and ``"probability"`` for one channel, ``"class_logits"`` and
            ``"class_probabilities"`` for one channel a class, ``"labels"`` for class numbers.
        channel: the object's class where there are several.
        threshold: probability above which a pixel is the object's.
        mask_input: name of the input that takes the last mask as 0 to 1, (1, 1, h, w) or (1, h, w, 1); zeros before
            the first frame. None for networks without.
        states: output name -> input name of hidden states; zeros before the first frame.
        threads: CPU threads, None for ONNX Runtime's choice.
        providers: execution providers in order of preference, as ``("CUDAExecutionProvider",)``; the CPU is the last
            in any case.
    """

    layout: Layout = "nchw"
    colors: Colors = "rgb"
    size: tuple[int, int] | None = None
    multiple: int = 1
    scale: float = 1 / 255
    mean: Sequence[float] = (0.0, 0.0, 0.0)
    std: Sequence[float] = (1.0, 1.0, 1.0)
    image_input: str | None = None
    mask_output: str | None = None
    activation: Activation = "logit"
    channel: int = 1
    threshold: float = 0.5
    mask_input: str | None = None
    states: Mapping[str, str] = field(default_factory=dict)
    threads: int | None = None
    providers: Sequence[str] = ()

    def __post_init__(self):
        for name, choices in (("layout", Layout), ("colors", Colors), ("activation", Activation)):
            check_choice(name, getattr(self, name), get_args(choices))
        for name in ("mean", "std"):
            expected = "three finite numbers, std above 0"
            values = number_array(getattr(self, name), name, finite=False, expected=expected)
            if values.shape != (3,) or not np.isfinite(values).all() or (name == "std" and (values <= 0).any()):
                raise DenseVSError(f"{name} is {getattr(self, name)!r}; expected {expected}")
        if self.size is not None:
            check_pair("size", self.size, least=1, most=16384)
        check_whole("multiple", self.multiple, least=1, most=16384)
        check_whole("channel", self.channel, least=0)
        check_number("scale", self.scale)
        check_number("threshold", self.threshold, above=0, below=1)


class OnnxSegmenter:
    """Segments with the network in an ONNX file.

    Args:
        path: of the file.
        layout, colors, size, multiple, scale, mean, std: of the image, see :class:`OnnxOptions`.
        image_input, mask_output, activation, channel, threshold, mask_input, states: of the network, likewise.
        threads, providers: of ONNX Runtime, likewise.

    Attributes:
        options: what it was made with.

    Raises:
        DenseVSError: ONNX Runtime is not installed, the file is missing or not a network that it runs, a named input,
            output or provider is not there, or the inputs do not fit the options.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        layout: Layout = "nchw",
        colors: Colors = "rgb",
        size: tuple[int, int] | None = None,
        multiple: int = 1,
        scale: float = 1 / 255,
        mean: Sequence[float] = (0.0, 0.0, 0.0),
        std: Sequence[float] = (1.0, 1.0, 1.0),
        image_input: str | None = None,
        mask_output: str | None = None,
        activation: Activation = "logit",
        channel: int = 1,
        threshold: float = 0.5,
        mask_input: str | None = None,
        states: Mapping[str, str] | None = None,
        threads: int | None = None,
        providers: Sequence[str] = (),
    ):
        self.options = OnnxOptions(
            layout=layout,
            colors=colors,
            size=size,
            multiple=multiple,
            scale=scale,
            mean=mean,
            std=std,
            image_input=image_input,
            mask_output=mask_output,
            activation=activation,
            channel=channel,
            threshold=threshold,
            mask_input=mask_input,
            states={} if states is None else states,
            threads=threads,
            providers=providers,
        )
        self._session = _open(input_file(path, most=MOST_BYTES), self.options)
        self._inputs = {one.name: one for one in self._session.get_inputs()}
        self._outputs = {one.name: one for one in self._session.get_outputs()}
        self._check_names()
        self.reset()

    def reset(self) -> None:
        """Forget the last mask and the hidden states."""
        self._mask: np.ndarray | None = None
        self._states: dict[str, np.ndarray] = {}

    def remember(self, mask: np.ndarray) -> None:
        """Give a recurrent network the object's mask, bool ``(H, W)``, in the frame before the next one.

        Raises:
            DenseVSError: not a mask, or a network that takes none.
        """
        if self.options.mask_input is None:
            raise DenseVSError("the network takes no mask; expected the option mask_input to name its input")
        self._mask = check_mask(mask).astype(np.float32)

    def segment(self, image: np.ndarray) -> np.ndarray:
        """The object's mask, bool ``(H, W)``, in an RGB uint8 image ``(H, W, 3)``.

        Raises:
            DenseVSError: not such an image, the network failed, or its answer is not of a mask's shape or not finite;
                last mask and states stay.
        """
        image = check_image(image)
        height, width = image.shape[:2]
        name = self._image_name()
        size = self._size(self._inputs[name], height, width)
        feeds = {name: self._image_tensor(image, size)}
        if self.options.mask_input is not None:
            feeds[self.options.mask_input] = self._mask_tensor(size)
        for source in self.options.states.values():
            feeds[source] = self._states[source] if source in self._states else self._zeros(source, size)
        asked = [self._mask_name(), *self.options.states]
        try:
            answer, *states = self._session.run(asked, feeds)
        except Exception as error:  # ONNX Runtime's own exceptions have no common public class
            shapes = {key: value.shape for key, value in feeds.items()}
            raise DenseVSError(f"the network failed on inputs of shapes {shapes}: {error}") from error
        probability = self._probability(np.asarray(answer))
        full = cv2.resize(probability, (width, height), interpolation=cv2.INTER_LINEAR)
        mask = full > self.options.threshold
        self._mask = mask.astype(np.float32)
        self._states = dict(zip(self.options.states.values(), map(np.asarray, states), strict=True))
        return mask

    def _check_names(self) -> None:
        given = self.options
        for kind, known, names in (
            ("input", self._inputs, [given.image_input, given.mask_input, *given.states.values()]),
            ("output", self._outputs, [given.mask_output, *given.states]),
        ):
            for name in names:
                if name is not None and name not in known:
                    raise DenseVSError(f"{kind} {name!r} is not in the network; expected one of {', '.join(known)}")
        left = set(self._inputs) - {given.mask_input, *given.states.values()}
        if given.image_input is None and len(left) != 1:
            raise DenseVSError(f"the network has the inputs {', '.join(sorted(left))}; name one as image_input")
        unfed = left - {self._image_name()}
        if unfed:
            raise DenseVSError(f"inputs {', '.join(sorted(unfed))} get nothing; name them in mask_input or states")
        for name in (self._image_name(), *given.states.values(), given.mask_input):
            if name is not None and self._inputs[name].type not in _TYPES:
                raise DenseVSError(f"input {name!r} is {self._inputs[name].type}; expected one of {', '.join(_TYPES)}")
        shape = self._inputs[self._image_name()].shape
        channel = shape[1 if given.layout == "nchw" else 3] if len(shape) == 4 else None
        if len(shape) != 4 or (isinstance(channel, int) and channel != 3):
            raise DenseVSError(
                f"input {self._image_name()!r} has shape {shape}; expected {given.layout} with 3 channels"
            )

    def _image_name(self) -> str:
        taken = {self.options.mask_input, *self.options.states.values()}
        return self.options.image_input or next(name for name in self._inputs if name not in taken)

    def _mask_name(self) -> str:
        return self.options.mask_output or next(name for name in self._outputs if name not in self.options.states)

    def _size(self, tensor: Any, height: int, width: int) -> tuple[int, int]:
        """Height and width that the network sees."""
        if self.options.size is not None:
            return self.options.size
        own = tensor.shape[2:4] if self.options.layout == "nchw" else tensor.shape[1:3]
        step = self.options.multiple
        rounded = [-(-side // step) * step for side in (height, width)]
        sides = [fixed if isinstance(fixed, int) else side for fixed, side in zip(own, rounded, strict=True)]
        return sides[0], sides[1]

    def _image_tensor(self, image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        shrinks = size[0] < image.shape[0]
        resized = cv2.resize(image, size[::-1], interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        if self.options.colors == "bgr":
            resized = resized[..., ::-1]
        dtype = _TYPES[self._inputs[self._image_name()].type]
        if dtype is np.uint8:  # a network that normalizes by itself
            return self._batched(np.ascontiguousarray(resized), dtype)
        mean, std = (np.asarray(values, dtype=np.float32) for values in (self.options.mean, self.options.std))
        return self._batched((resized.astype(np.float32) * np.float32(self.options.scale) - mean) / std, dtype)

    def _mask_tensor(self, size: tuple[int, int]) -> np.ndarray:
        mask = np.zeros(size, np.float32) if self._mask is None else self._mask
        resized = cv2.resize(mask, size[::-1], interpolation=cv2.INTER_LINEAR)
        return self._batched(resized[..., None], _TYPES[self._inputs[str(self.options.mask_input)].type])

    def _batched(self, planes: np.ndarray, dtype: Any) -> np.ndarray:
        """(h, w, c) as the network's tensor of four dimensions."""
        ordered = planes.transpose(2, 0, 1) if self.options.layout == "nchw" else planes
        return np.ascontiguousarray(ordered[None]).astype(dtype)

    def _zeros(self, name: str, size: tuple[int, int]) -> np.ndarray:
        """A hidden state before the first frame: open sides of four dimensions take the image's, others 1."""
        shape = list(self._inputs[name].shape)
        image_axes = {2: size[0], 3: size[1]} if self.options.layout == "nchw" else {1: size[0], 2: size[1]}
        axes = image_axes if len(shape) == 4 else {}
        sides = [side if isinstance(side, int) else axes.get(axis, 1) for axis, side in enumerate(shape)]
        return np.zeros(sides, _TYPES[self._inputs[name].type])

    def _probability(self, answer: np.ndarray) -> np.ndarray:
        """The object's probability (h, w) float32 from the network's answer."""
        kind, channel = self.options.activation, self.options.channel
        planes = answer[0] if answer.ndim == 4 else answer
        if planes.ndim == 3 and answer.ndim == 4 and self.options.layout == "nhwc":
            planes = planes.transpose(2, 0, 1)
        if planes.ndim == 2:
            planes = planes[None]
        if planes.ndim != 3 or not planes.size or (answer.ndim == 4 and len(answer) != 1):
            raise DenseVSError(f"the network's answer has shape {answer.shape}; expected one mask")
        if kind == "labels":
            if len(planes) != 1:
                raise DenseVSError(f"the network's answer has shape {answer.shape}; expected one plane of labels")
            return (np.rint(planes[0]) == channel).astype(np.float32)
        values = planes.astype(np.float32)
        if not np.isfinite(values).all():
            raise DenseVSError("the network's answer is not finite; expected finite numbers")
        if kind in ("logit", "probability"):
            if len(values) != 1:
                raise DenseVSError(
                    f"the network's answer has {len(values)} channels; expected one, or activation 'class_logits' or "
                    "'class_probabilities'"
                )
            return values[0] if kind == "probability" else _sigmoid(values[0])
        if channel >= len(values):
            raise DenseVSError(f"channel is {channel}; expected below the answer's {len(values)}")
        if kind == "class_probabilities":
            return values[channel]
        shifted = np.exp(values - values.max(axis=0))
        return shifted[channel] / shifted.sum(axis=0)


def _open(path: Path, options: OnnxOptions) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise DenseVSError(
            "neural segmenters need ONNX Runtime, which is not installed; pip install 'dense-vs[vos]'"
        ) from error
    if not path.is_file():
        raise DenseVSError(f"network {path} does not exist")
    present = onnxruntime.get_available_providers()
    for provider in options.providers:
        if provider not in present:
            raise DenseVSError(f"provider {provider!r} is not present; expected some of {', '.join(present)}")
    settings = onnxruntime.SessionOptions()
    settings.log_severity_level = 3  # errors come as exceptions
    if options.threads is not None:
        settings.intra_op_num_threads = options.threads
    providers = list(dict.fromkeys([*options.providers, "CPUExecutionProvider"]))
    try:
        return onnxruntime.InferenceSession(str(path), settings, providers=providers)
    except Exception as error:  # as in segment
        raise DenseVSError(f"{path} is not a network that ONNX Runtime runs: {error}") from error


def _sigmoid(values: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-np.clip(values, -60, 60)))
