"""A segmenter that learns an object from about ten annotated images in seconds, on a CPU: the vos(I, W) of VOS-VS (2).

The paper fine-tunes a neural network (OSVOS) for every object on a GPU. Here, beyond the paper, an image falls into
superpixels that merge into a tree of candidate regions, and the candidate that a random forest expects to overlap the
object best is the object: choosing among some thousand whole regions needs far fewer examples than labeling
pixels one by one, and gives masks with the image's own outlines.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from dense_vs.checks import check_number, check_whole, is_list, shown
from dense_vs.errors import DenseVSError
from dense_vs.files import atomic_write, parse_json, read_arrays, stored_array
from dense_vs.segmentation.few_shot.candidate_regions import mask_share, overlaps, see
from dense_vs.segmentation.few_shot.color_words import ColorWords
from dense_vs.segmentation.few_shot.decision_forest import DecisionForest
from dense_vs.segmentation.few_shot.mask_refinement import refine_mask
from dense_vs.segmentation.few_shot.object_track import Doubt, FoundRegion, ObjectTrack, Window
from dense_vs.segmentation.few_shot.training import ObjectModel, learn_object
from dense_vs.segmentation.segmenter import check_image, check_mask

FORMAT = "dense-vs few-shot segmenter"
FORMAT_VERSION = 2
COLORS = 1 << 15  # 5 bits a channel
MOST_SEED = (1 << 32) - 1  # that scikit-learn takes
WINDOW_AREA = 16_000  # px; larger windows are reduced


@dataclass(frozen=True, kw_only=True)
class FewShotOptions:
    """How an object is learned and found.

    Attributes:
        size: longer side of the image that is looked at [px]; larger images are reduced to it.
        samples: pixels of the object drawn from every annotated image, three times as many of the background.
        min_area: smallest region that may be the object [px of the reduced image].
        min_score: least predicted overlap that counts as having found the object, as a share of what the object's
            images lead to expect.
        memory: how much a region gains by overlapping the last mask, in units of predicted overlap; 0 for stills.
        window: how far around the last mask's box the object is looked for first [px of the reduced image]; 0 for
            everywhere at once. Windows of large objects are reduced further, and the mask is then brought to the
            image's outlines. Where what is found there is doubted, the whole image is looked at in the same frame.
        seed: of the drawn pixels and of the forests, below 2^32.
    """

    size: int = 320
    samples: int = 1500
    min_area: int = 12
    min_score: float = 0.5
    memory: float = 0.3
    window: int = 16
    seed: int = 0

    def __post_init__(self):
        for name, least in (("size", 32), ("samples", 10), ("min_area", 1), ("window", 0)):
            check_whole(name, getattr(self, name), least=least)
        check_whole("seed", self.seed, least=0, most=MOST_SEED)
        for name in ("min_score", "memory"):
            check_number(name, getattr(self, name), least=0.0, below=1.0)


class FewShotSegmenter:
    """Finds one object after having seen it in about ten annotated images, and follows it from image to image.

    Images are those of one camera, one after the other; call :meth:`reset` where they are not, as between stills.

    Args:
        size, samples, min_area, min_score, memory, window, seed: see :class:`FewShotOptions`.

    Attributes:
        options: what it was made with.
        score: predicted overlap of the last mask with the object, 0 where nothing was worth a mask.
        everywhere: whether the whole of the last image was looked at.
        doubt: why, where the object had been found in the image before; None otherwise.

    Raises:
        DenseVSError: an option out of range.
    """

    def __init__(
        self,
        *,
        size: int = 320,
        samples: int = 1500,
        min_area: int = 12,
        min_score: float = 0.5,
        memory: float = 0.3,
        window: int = 16,
        seed: int = 0,
    ):
        self.options = FewShotOptions(
            size=size, samples=samples, min_area=min_area, min_score=min_score, memory=memory, window=window, seed=seed
        )
        self._model: ObjectModel | None = None
        self._track = ObjectTrack()
        self.everywhere: bool
        self.doubt: Doubt | None
        self.reset()

    def fit(self, images: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> "FewShotSegmenter":
        """Learn the object; what was learned before is forgotten.

        Args:
            images: RGB uint8 ``(H, W, 3)``, of any sizes; the object from the sides and at the distances that it
                will be seen at, before the backgrounds that it will be seen before.
            masks: bool ``(H, W)``, the object in each; an empty one says that it is not there.

        Returns:
            The segmenter itself.

        Raises:
            DenseVSError: no image, another number of masks, sizes that differ, no pixel of the object or of the
                background at all, or scikit-learn is not installed; what was learned before stays.
        """
        options = self.options
        pairs = _checked_pairs(images, masks)
        reduced = [self._reduced(image) for image, _ in pairs]
        shares = [
            cv2.resize(mask.astype(np.float32), image.shape[1::-1], interpolation=cv2.INTER_AREA)
            for image, (_, mask) in zip(reduced, pairs, strict=True)
        ]
        if not any((share > 0.75).any() for share in shares):
            raise DenseVSError(f"the object fills no pixel of the images reduced to {options.size} px; expected larger")
        self._model = learn_object(
            reduced, shares, samples=options.samples, min_area=options.min_area, seed=options.seed
        )
        self.reset()
        return self

    def segment(self, image: np.ndarray) -> np.ndarray:
        """The object's mask, bool ``(H, W)``, in an RGB uint8 image ``(H, W, 3)``; all false where it is not found.

        Raises:
            DenseVSError: not such an image, or nothing was learned yet.
        """
        image = check_image(image)
        self._learned()
        height, width = image.shape[:2]
        reduced = self._reduced(image)
        found, self.doubt = self._find_near(reduced, (height, width))
        self.everywhere = found is None
        if found is None:
            found = self._find(reduced, Window.of_image(reduced.shape[:2]))
        if found is None:
            self._track.forget()
            self.score = 0.0
            return np.zeros((height, width), dtype=bool)
        mask = refine_mask(image, _smooth(found.pixels, (width, height)))
        self._track.follow(mask, found, anew=self.everywhere)
        self.score = found.score
        return mask

    def _find_near(self, image: np.ndarray, size: tuple[int, int]) -> tuple[FoundRegion | None, Doubt | None]:
        """The object's region of a reduced image, looked for around the last one alone, or why it is not taken."""
        margin, track = self.options.window, self._track
        if not margin or track.mask is None:
            return None, None
        window = track.window(image.shape[:2], margin)
        if window is None or track.mask.shape != size:
            return None, Doubt.OTHER_SIZE
        found = self._find(image, window)
        doubt = track.doubt(found, window)
        return (found, None) if doubt is None else (None, doubt)

    def _find(self, image: np.ndarray, window: Window) -> FoundRegion | None:
        """The object's region of a reduced image, looked for in a part of it; None where nothing is worth it."""
        model, shape = self._learned(), image.shape[:2]
        rows, columns = window.rows, window.columns
        part = np.ascontiguousarray(image[rows, columns])
        size = part.shape[1::-1]
        share = min(1.0, WINDOW_AREA / (size[0] * size[1])) if part.size < image.size else 1.0
        if share < 1:
            part = cv2.resize(part, None, fx=share**0.5, fy=share**0.5, interpolation=cv2.INTER_AREA)
        seen = see(part, round(share * shape[0] * shape[1]))
        found, score, _ = model.candidates(seen, share * self.options.min_area)
        gain = np.zeros(len(score))
        if self._track.mask is not None:
            last = cv2.resize(self._track.mask.astype(np.float32), shape[::-1], interpolation=cv2.INTER_AREA)
            gain = self.options.memory * overlaps(seen, found, mask_share(seen, last[rows, columns]))
        least = self.options.min_score * model.expected_score
        if not len(score) or score[best := int(np.argmax(score + gain))] + gain[best] < least:
            return None
        region = np.zeros(shape, dtype=bool)
        mask = found.trees[found.tree[best]].mask(seen.pixels, int(found.node[best]))
        region[rows, columns] = _smooth(mask, size) if share < 1 else mask
        return FoundRegion(region, float(score[best])) if region.any() else None

    def probability(self, image: np.ndarray) -> np.ndarray:
        """Probability of the object (h, w) float32 by color and texture alone, on the reduced image: to look at."""
        model = self._learned()
        seen = see(self._reduced(check_image(image)))
        likely = model.candidates(seen, self.options.min_area)[2]
        return likely[seen.pixels.labels].astype(np.float32)

    def reset(self) -> None:
        """Forget the last mask: the next image may show the object anywhere."""
        self._track.forget()
        self.score, self.everywhere, self.doubt = 0.0, False, None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write options and what was learned as ``.npz``, without pickle.

        Raises:
            DenseVSError: nothing was learned, or the file cannot be written.
        """
        model = self._learned()
        header = {"format": FORMAT, "version": FORMAT_VERSION, "options": asdict(self.options)}
        arrays = {
            "words": model.words.table,
            "examples": model.examples,
            "expected_score": np.array(model.expected_score),
            **model.pixel_forest.arrays("pixel"),
            **model.region_forest.arrays("region"),
        }
        with atomic_write(path) as stream:
            content: dict[str, Any] = {"header": np.array(json.dumps(header)), **arrays}
            np.savez_compressed(stream, **content)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "FewShotSegmenter":
        """Read what :meth:`save` wrote.

        Raises:
            DenseVSError: missing, damaged, of another kind or of another version.
        """
        stored = read_arrays(path, FORMAT)
        try:
            header = parse_json(str(stored["header"]))
            if (header["format"], header["version"]) != (FORMAT, FORMAT_VERSION):
                raise DenseVSError(
                    f"it is {shown(header['format'])} version {shown(header['version'])}; expected version "
                    f"{FORMAT_VERSION}"
                )
            segmenter = cls(**header["options"])
            examples = stored_array(stored, "examples", (-1, -1))
            table = stored_array(stored, "words", (COLORS,), "iu")
            if not examples.size or table.min() < 0 or table.max() >= examples.shape[1]:
                raise DenseVSError("its color words do not fit together")
            segmenter._model = ObjectModel(
                ColorWords(examples.shape[1], table),
                examples,
                DecisionForest.from_arrays(stored, "pixel"),
                DecisionForest.from_arrays(stored, "region"),
                float(stored_array(stored, "expected_score", ())),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise DenseVSError(f"cannot read {path} as {FORMAT}: {error}") from error
        return segmenter

    def _learned(self) -> ObjectModel:
        if self._model is None:
            raise DenseVSError("the segmenter has not learned an object; call fit(images, masks) or load(path) first")
        return self._model

    def _reduced(self, image: np.ndarray) -> np.ndarray:
        height, width = image.shape[:2]
        factor = min(1.0, self.options.size / max(height, width))
        size = (max(16, round(width * factor)), max(16, round(height * factor)))
        return cv2.resize(image, size, interpolation=cv2.INTER_AREA) if factor < 1 else image


def _checked_pairs(images: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    if not (is_list(images) and is_list(masks)):
        raise DenseVSError(f"images are a {type(images).__name__} and masks a {type(masks).__name__}; expected lists")
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


def _smooth(region: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A region of the reduced image as a mask of another size (width, height), without steps."""
    soft = cv2.GaussianBlur(region.astype(np.float32), (0, 0), 0.7)
    return cv2.resize(soft, size, interpolation=cv2.INTER_LINEAR) > 0.5
