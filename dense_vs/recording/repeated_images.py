"""Repeated images: a camera that gives 15 images a second into a file of 30 writes every image twice.

The repetition has no image motion, while the joints went on, so its joint step belongs to the next image. After
re-encoding it is not equal to the image before, but differs by the encoder's noise, which has no place and no
direction. Motion has both: somewhere the difference is many times that of the usual block, or it is the image
gradient times one displacement a block. Beyond the papers, whose camera gave no image twice.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from dense_vs.robot.camera_image import check_gray

WORK_WIDTH = 320  # px; wider images are averaged down to it, which also averages noise away
BLOCK = 16  # px
IDENTICAL = 0.02  # mean difference of gray levels below which nothing was encoded anew
SURE_DIFFERENCE = 2.5  # mean difference of gray levels that no encoder makes of the same image
# A coarse x264 with one thread shifts whole blocks of a repetition, to ratios of 13 and shares of 0.95: not told here.
UNEVEN = 4.5  # ratio of the strongest blocks' difference to the median one's; re-encoding made up to 3.8
LEAST_UNEVEN = 3.0  # gray levels; an encoder that improves a few blocks of the same image made up to 1.9
EXPLAINED = 0.65  # share of the strongest blocks' difference that a displacement explains; re-encoding up to 0.57
LEAST_NOISE = 0.3  # gray levels; below it a block's difference counts as none
WHOLE_IMAGE_NOISE = 0.4  # gray levels; the median block of an image that was encoded anew, at rest
LONGEST_REPETITION = 5  # images; a longer rest of the picture is a scene in which nothing moves


@dataclass(frozen=True)
class ImageChange:
    """How an image differs from another one of the same camera.

    Attributes:
        mean: mean absolute difference [gray levels].
        strongest: root mean square difference of the block that 97 % of the blocks stay below [gray levels].
        usual: the same of the median block.
        explained: share of the difference that a displacement explains, exceeded in 5 % of the blocks.
    """

    mean: float
    strongest: float
    usual: float
    explained: float

    @property
    def noise(self) -> float:
        """Difference of a block in which nothing moved [gray levels]."""
        return max(self.usual, LEAST_NOISE)

    @property
    def identical(self) -> bool:
        """Whether it is the same image, bit by bit but for a few."""
        return self.mean < IDENTICAL

    @property
    def moved(self) -> bool:
        """Whether something moved in between."""
        if self.identical:
            return False
        uneven = self.strongest > max(UNEVEN * self.noise, LEAST_UNEVEN)
        directed = self.explained > EXPLAINED and self.strongest > LEAST_NOISE
        return self.mean > SURE_DIFFERENCE or uneven or directed


class ChangeMeter:
    """Compares images of one camera; prepares each of them once."""

    def prepare(self, gray: np.ndarray) -> np.ndarray:
        """What :meth:`change` takes: float32, at most 320 px wide, of a gray uint8 ``(H, W)``."""
        height, width = gray.shape
        if width > WORK_WIDTH:
            size = WORK_WIDTH, max(round(height * WORK_WIDTH / width), BLOCK)
            gray = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
        return gray.astype(np.float32)

    def change(self, before: np.ndarray, now: np.ndarray) -> ImageChange:
        """How ``now`` differs from ``before``, both from :meth:`prepare`."""
        difference = now - before
        mean = float(np.mean(np.abs(difference)))
        if mean < IDENTICAL:
            return ImageChange(mean, 0.0, 0.0, 0.0)
        difference = cv2.GaussianBlur(difference, (0, 0), 1.0)
        difference -= cv2.blur(difference, (BLOCK, BLOCK))  # brightness that changed is no motion
        middle = cv2.GaussianBlur(0.5 * (before + now), (0, 0), 1.0)
        dx = cv2.Sobel(middle, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
        dy = cv2.Sobel(middle, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
        energy = _block_means(difference * difference)
        ridge = 0.5  # keeps flat blocks from explaining anything
        xx, xy, yy = _block_means(dx * dx) + ridge, _block_means(dx * dy), _block_means(dy * dy) + ridge
        xd, yd = _block_means(dx * difference), _block_means(dy * difference)
        explained = (yy * xd * xd - 2 * xy * xd * yd + xx * yd * yd) / (xx * yy - xy * xy)
        size = np.sqrt(energy)
        share = explained / np.maximum(energy, LEAST_NOISE**2 / 4)
        return ImageChange(
            mean, float(np.quantile(size, 0.97)), float(np.median(size)), float(np.quantile(share, 0.95))
        )


class RepetitionFilter:
    """Tells, image by image, which ones bring new motion; needs no later image.

    An image without motion since the last kept one is held back, at most five in a row: after that the scene rests,
    and the image is kept as one in which nothing moved. Slow motion is held back until it has grown visible; it is
    not counted as repetition, as its first part would have been visible had it all happened in the last step.

    Attributes:
        repeated: images that were repetitions, so far.
    """

    def __init__(self):
        self.repeated = 0
        self._meter = ChangeMeter()
        self._kept: np.ndarray | None = None
        self._held: list[ImageChange | None] = []  # None where it is counted

    def keep(self, gray: np.ndarray) -> bool:
        """Whether the next image, gray uint8 ``(H, W)``, is to be used with the last kept one.

        Raises:
            DenseVSError: no such image.
        """
        image = self._meter.prepare(check_gray(gray))
        if self._kept is None or self._kept.shape != image.shape:
            self.restart()
            self._kept = image
            return True
        change = self._meter.change(self._kept, image)
        self._count(change)
        if not change.moved and len(self._held) < LONGEST_REPETITION:
            self._held.append(change)
            return False
        self._held = []
        self._kept = image
        return True

    def restart(self) -> None:
        """Forget the last image, after a gap."""
        self._kept, self._held = None, []

    def _count(self, change: ImageChange) -> None:
        """Count the images held back that this one proves to be repetitions.

        It does by a motion that had shown in them, or by a whole image encoded anew where they were equal bit by bit.
        """
        anew = not change.identical and change.usual >= WHOLE_IMAGE_NOISE
        for k, held in enumerate(self._held):
            if held is None:
                continue
            share = (k + 1) / (len(self._held) + 1)
            if (anew and held.identical) or (change.moved and _would_have_shown(change, held, share)):
                self.repeated += 1
                self._held[k] = None


def _would_have_shown(change: ImageChange, held: ImageChange, share: float) -> bool:
    """Whether this share of the motion that came would have been seen in the image that was held back."""
    return change.strongest * share > UNEVEN * held.noise or change.mean * share > SURE_DIFFERENCE


def _block_means(image: np.ndarray) -> np.ndarray:
    """Means of blocks of 16 x 16 px; what is left over at the right and lower border is left out."""
    height, width = (max(side // BLOCK, 1) for side in image.shape)
    cut = image[: height * BLOCK, : width * BLOCK]
    return cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA)
