"""A segmenter that learns an object from about ten annotated images in seconds, on a CPU: the vos(I, W) of VOS-VS (2).

The paper fine-tunes a neural network (OSVOS) for every object on a GPU; here pixels are classified by colour and
texture around them at several scales, and the largest believed region is the object. Beyond the paper.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import cv2
import numpy as np

from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, read_arrays
from dense_vs.segmentation.pixel_classifier import PixelClassifier
from dense_vs.segmentation.pixel_features import pixel_features
from dense_vs.segmentation.segmenter import check_image, check_mask

FORMAT = "dense-vs few-shot segmenter"
FORMAT_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class FewShotOptions:
    """How an object is learnt and found.

    Attributes:
        size: longer side of the image that is classified [px].
        samples: pixels of the object drawn from every image; three times as many of the background.
        threshold: probability above which a pixel is the object's.
        memory: share of the previous frame's probability that is kept where it was; 0 for stills.
        seed: of the drawn pixels and of the classifier.
    """

    size: int = 320
    samples: int = 1500
    threshold: float = 0.5
    memory: float = 0.3
    seed: int = 0

    def __post_init__(self):
        for name, least in (("size", 32), ("samples", 10), ("seed", 0)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
                raise DenseVSError(f"{name} is {value!r}; expected a whole number of at least {least}")
        for name, low, high in (("threshold", 0.0, 1.0), ("memory", -1e-9, 1.0)):
            value = getattr(self, name)
            if not isinstance(value, (int, float, np.number)) or not low < value < high:
                raise DenseVSError(f"{name} is {value!r}; expected a number between 0 and 1")


class FewShotSegmenter:
    """Finds one object after having seen it in about ten annotated images.

    Args:
        options: the fields of :class:`FewShotOptions`.

    Raises:
        DenseVSError: an option that is unknown or out of range.
    """

    def __init__(self, **options: Any):
        known = [field.name for field in fields(FewShotOptions)]
        for name in options:
            if name not in known:
                raise DenseVSError(f"unknown option {name!r}; expected {', '.join(known)}")
        self.options = FewShotOptions(**options)
        self._classifier: PixelClassifier | None = None
        self._previous: np.ndarray | None = None

    def fit(self, images: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> "FewShotSegmenter":
        """Learn the object; what was learnt before is forgotten.

        Args:
            images: RGB uint8 ``(H, W, 3)``, of any sizes.
            masks: bool ``(H, W)``, the object in each; an empty one says that it is not there.

        Returns:
            The segmenter itself.

        Raises:
            DenseVSError: no image, another number of masks, sizes that differ, or no pixel of the object or of the
                background at all; what was learnt before stays.
        """
        pairs = _checked_pairs(images, masks)
        rng = np.random.default_rng(self.options.seed)
        drawn = [self._samples(image, mask, rng) for image, mask in pairs]
        features = np.concatenate([f for f, _ in drawn])
        inside = np.concatenate([i for _, i in drawn])
        self._classifier = PixelClassifier.fit(features, inside, seed=self.options.seed)
        self.reset()
        return self

    def segment(self, image: np.ndarray) -> np.ndarray:
        """The object's mask, bool ``(H, W)``, in an RGB uint8 image ``(H, W, 3)``; all false where it is not seen.

        Raises:
            DenseVSError: not such an image, or nothing was learnt yet.
        """
        image = check_image(image)
        probability = self.probability(image)
        if self._previous is not None and self._previous.shape == probability.shape:
            probability = probability * (1 - self.options.memory) + self.options.memory * self._previous
        mask = _likeliest_region(probability, self.options.threshold)
        self._previous = np.where(mask, probability, 0)
        height, width = image.shape[:2]
        smooth = np.where(cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)), probability, 0)
        return cv2.resize(smooth.astype(np.float32), (width, height)) > self.options.threshold

    def probability(self, image: np.ndarray) -> np.ndarray:
        """Probability of the object at every pixel of the reduced image, float32 ``(h, w)``, before regions."""
        if self._classifier is None:
            raise DenseVSError("the segmenter has not learnt an object; call fit(images, masks) or load(path) first")
        return cv2.GaussianBlur(self._classifier.probability(pixel_features(self._reduced(image))), (0, 0), 1.0)

    def reset(self) -> None:
        """Forget the previous image: the next one may show the object anywhere."""
        self._previous = None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write options and weights as ``.npz``, without pickle.

        Raises:
            DenseVSError: nothing was learnt, or the file cannot be written.
        """
        if self._classifier is None:
            raise DenseVSError("the segmenter has not learnt an object; call fit(images, masks) before save")
        header = {"format": FORMAT, "version": FORMAT_VERSION, "options": asdict(self.options)}
        with atomic_write(path) as stream:
            np.savez(stream, header=np.array(json.dumps(header)), **vars(self._classifier))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "FewShotSegmenter":
        """Read what :meth:`save` wrote.

        Raises:
            DenseVSError: missing, damaged, of another kind or of a later version.
        """
        stored = read_arrays(path, FORMAT)
        try:
            header = json.loads(str(stored.pop("header")))
            if (header["format"], header["version"]) != (FORMAT, FORMAT_VERSION):
                raise DenseVSError(f"{path} is {header['format']!r} version {header['version']}; expected {FORMAT!r} 1")
            segmenter = cls(**header["options"])
            segmenter._classifier = PixelClassifier(**stored)
        except (KeyError, TypeError, ValueError) as error:
            raise DenseVSError(f"cannot read {path} as {FORMAT}: {error}") from error
        return segmenter

    def _reduced(self, image: np.ndarray) -> np.ndarray:
        height, width = image.shape[:2]
        factor = min(1.0, self.options.size / max(height, width))
        size = (max(1, round(width * factor)), max(1, round(height * factor)))
        return cv2.resize(image, size, interpolation=cv2.INTER_AREA) if factor < 1 else image

    def _samples(self, image: np.ndarray, mask: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Features of pixels drawn inside, around and far from the object, and which of them are inside."""
        reduced = self._reduced(image)
        features = pixel_features(reduced)
        height, width = reduced.shape[:2]
        share = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
        around = cv2.dilate((share > 0.25).astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
        wanted = ((share > 0.75, 1), ((share < 0.25) & around, 1), (share < 0.25, 2))
        rows, inside = [], []
        for part, (where, times) in enumerate(wanted):
            pixels = np.flatnonzero(where)
            count = self.options.samples * times if pixels.size else 0
            rows.append(rng.choice(pixels, count, replace=pixels.size < count) if count else pixels)
            inside.append(np.full(count, part == 0))
        return features.reshape(height * width, -1)[np.concatenate(rows)], np.concatenate(inside)


def _checked_pairs(images: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    if len(images) != len(masks) or not len(images):
        raise DenseVSError(f"{len(images)} images and {len(masks)} masks; expected as many of both, at least one")
    pairs = []
    for number, (image, mask) in enumerate(zip(images, masks, strict=True)):
        checked = check_image(image), check_mask(mask, f"mask {number}")
        if checked[0].shape[:2] != checked[1].shape:
            raise DenseVSError(
                f"mask {number} has shape {checked[1].shape}; expected its image's, {checked[0].shape[:2]}"
            )
        pairs.append(checked)
    if not any(mask.any() for _, mask in pairs) or all(mask.all() for _, mask in pairs):
        raise DenseVSError("the masks hold no pixel of the object or none of the background; expected both")
    return pairs


def _likeliest_region(probability: np.ndarray, threshold: float) -> np.ndarray:
    """The connected region above the threshold with the largest sum of probability; empty where none is."""
    count, labels = cv2.connectedComponents((probability > threshold).astype(np.uint8), connectivity=8)
    if count < 2:
        return np.zeros(probability.shape, dtype=bool)
    weight = np.bincount(labels.ravel(), probability.ravel(), minlength=count)
    return labels == 1 + int(np.argmax(weight[1:]))
