"""Masks of an object that a camera approaches, as a segmenter would deliver them, with the true distance.

An own model of the world, from which no recording is needed: flat outlines and solids of boxes, ellipsoids and
cylinders in any pose, seen in perspective by a camera that moves almost along its optical axis. The masks then suffer
what segmentation does to them: an outline grown or shrunk in all views or by view, a wavering outline, leaks, splits,
an occluding edge, regions of other objects, specks, missing views, and the image border.
"""

from dataclasses import dataclass

import cv2
import numpy as np

HEIGHT, WIDTH = 480, 640
_shift = 4  # bits below the pixel in OpenCV's polygon coordinates
_margin = 14  # px around an outline that its noise may reach


@dataclass(frozen=True)
class MaskSequence:
    """A simulated approach.

    Attributes:
        masks: ``(m, 480, 640)`` uint8, 0 or 1, nearest view first.
        camera_back: ``(m,)`` [m], how far the camera stands behind its nearest position.
        distance: [m], from the nearest camera position to the object: along the optical axis, in the mean over the
            outline that it shows there, which is the part of it that a mask tells about.
    """

    masks: np.ndarray
    camera_back: np.ndarray
    distance: float


def simulate_masks(random: np.random.Generator) -> MaskSequence:
    """One random approach, all its choices from ``random``."""
    travel = float(np.exp(random.uniform(np.log(0.05), np.log(20.0))))
    distance = travel * float(np.clip(np.exp(random.normal(0.0, 0.8)), 0.08, 8.0))
    back = _stations(random) * travel
    camera = _Camera.draw(random, distance, back)
    on_axis = random.random() < 0.65
    target = _Thing.draw(random, distance, camera, on_axis)
    # Among several things only its place on the axis says which is meant.
    others = _others(random, distance, camera) if on_axis and random.random() < 0.6 else []
    noise = _Noise.draw(random)
    occluder = _occluder(random, distance, target, camera) if random.random() < 0.2 else None
    masks = np.zeros((len(back), HEIGHT, WIDTH), dtype=np.uint8)
    for view in range(len(back)):
        if random.random() < noise.missing:
            continue
        mask = noise.on(target.silhouette(camera, view), random)
        if occluder is not None:
            mask &= ~_filled([camera.project(occluder, view)]).astype(bool)
        for other, seen in others:
            if random.random() < seen:
                mask |= noise.on(other.silhouette(camera, view), random)
        for _ in range(random.poisson(noise.specks)):
            place, size = random.uniform((0, 0), (WIDTH, HEIGHT)), random.uniform(1.0, 8.0, 2)
            _ellipse(mask, place, size, random)
        masks[view] = mask
    return MaskSequence(masks, back, target.outline_distance(camera))


@dataclass(frozen=True)
class _Camera:
    focal: float  # px
    axis: np.ndarray  # (2,) px, the image point that the camera moves towards
    shift: np.ndarray  # (m, 2) m, sideways
    back: np.ndarray  # (m,) m

    @classmethod
    def draw(cls, random: np.random.Generator, distance: float, back: np.ndarray) -> "_Camera":
        focal = random.uniform(0.7, 1.3) * WIDTH
        axis = 0.5 * np.array([WIDTH - 1, HEIGHT - 1]) + random.normal(0.0, 0.025 * WIDTH, 2)
        drift = random.normal(0.0, 0.01, 2) * (back / max(back.max(), 1e-9))[:, None]
        tremble = random.normal(0.0, 0.001 * random.random(), (len(back), 2))
        return cls(focal, axis, (drift + tremble) * distance, back)

    def project(self, points: np.ndarray, view: int) -> np.ndarray:
        """Image points of points (n, 3) in the frame of the nearest view."""
        z = np.maximum(points[:, 2] + self.back[view], 1e-6)
        return self.axis + self.focal * (points[:, :2] - self.shift[view]) / z[:, None]


@dataclass(frozen=True)
class _Thing:
    parts: list[np.ndarray]  # corners (n, 3); the outline as it stands of a flat one, the hull of each part of a solid
    flat: bool

    @classmethod
    def draw(cls, random: np.random.Generator, distance: float, camera: _Camera, on_axis: bool) -> "_Thing":
        pixels = float(np.exp(random.uniform(np.log(25.0), np.log(320.0))))
        size = pixels * distance / camera.focal  # m, at the nearest view
        if on_axis:
            off = random.normal(0.0, 0.04, 2) * WIDTH
        else:
            off = np.array([random.uniform(-0.4, 0.4) * WIDTH, random.normal(0.0, 0.1) * HEIGHT])
        centre = np.array([*(off * distance / camera.focal), distance])
        if random.random() < 0.4:
            flat = _flat_outline(random) * size
            corners = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)
            return cls([corners + centre], True)
        parts = []
        for _ in range(int(random.choice([1, 1, 1, 2, 3]))):
            apart = random.normal(0.0, 0.25, 3) * size if parts else np.zeros(3)
            parts.append(_solid(random) * size * (random.uniform(0.4, 1.0) if parts else 1.0) + apart)
        depth = np.concatenate(parts)[:, 2]
        # Its near side is at the distance, unless its depth would reach up to the camera.
        depth = np.concatenate(parts)[:, 2]
        front = float(depth[depth <= np.median(depth)].mean())
        room = max(0.0, 0.1 * distance - (distance + depth.min() - front))
        return cls([part + centre + [0.0, 0.0, room - front] for part in parts], False)

    def outline_distance(self, camera: _Camera) -> float:
        """Mean distance [m] over the outline as the nearest view shows it."""
        corners = np.concatenate(self.parts)
        image = camera.project(corners, 0).astype(np.float32)
        around = np.asarray(cv2.convexHull(image, returnPoints=False)[:, 0], dtype=np.int64)
        sides = np.linalg.norm(image[around] - image[np.roll(around, -1)], axis=1)
        middles = 0.5 * (corners[around, 2] + corners[np.roll(around, -1), 2])
        return float(sides @ middles / sides.sum())

    def silhouette(self, camera: _Camera, view: int) -> np.ndarray:
        """The mask, uint8 (H, W)."""
        outlines = [camera.project(part, view) for part in self.parts]
        if not self.flat:
            outlines = [cv2.convexHull(outline.astype(np.float32))[:, 0] for outline in outlines]
        return _filled(outlines)


@dataclass(frozen=True)
class _Noise:
    grown: float  # px, in every view
    grown_by_view: float  # px, standard deviation
    waver: float  # px, of the outline
    leak: float  # probability by view
    split: float
    missing: float
    specks: float  # mean number by view

    @classmethod
    def draw(cls, random: np.random.Generator) -> "_Noise":
        def sometimes(share: float, most: float) -> float:
            return random.uniform(0.0, most) if random.random() < share else 0.0

        return cls(
            random.normal(1.0, 2.0) if random.random() < 0.6 else 0.0,
            sometimes(0.5, 1.4),
            sometimes(0.5, 2.0),
            sometimes(0.3, 0.2),
            sometimes(0.2, 0.2),
            sometimes(0.2, 0.15),
            sometimes(0.3, 4.0),
        )

    def on(self, mask: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """The mask as it is segmented."""
        x, y, width, height = cv2.boundingRect(mask)
        if width == 0:
            return mask
        noisy = mask.copy()
        left, top = max(x - _margin, 0), max(y - _margin, 0)
        window = (slice(top, y + height + _margin), slice(left, x + width + _margin))
        grown = self.grown + random.normal() * self.grown_by_view
        if grown or self.waver:
            inside = np.pad(mask[window], 1, mode="edge")  # the object goes on beyond the image border
            distance = cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5) - cv2.distanceTransform(inside, cv2.DIST_L2, 5)
            if self.waver:
                field = cv2.GaussianBlur(random.normal(size=inside.shape), (0, 0), random.uniform(2.0, 8.0))
                distance += self.waver * field / max(float(field.std()), 1e-9)
            noisy[window] = (distance < grown)[1:-1, 1:-1]
        size = np.sqrt(float(mask.sum()))
        if random.random() < self.leak:
            ys, xs = np.nonzero(mask)
            at = random.integers(len(xs))
            _ellipse(noisy, np.array([xs[at], ys[at]]), random.uniform(0.1, 0.5, 2) * size, random)
        if random.random() < self.split:
            middle, angle = np.array([x + width / 2, y + height / 2]), random.uniform(0, np.pi)
            along = np.array([np.cos(angle), np.sin(angle)]) * size * 2
            start, end = (middle - along).astype(int).tolist(), (middle + along).astype(int).tolist()
            cv2.line(noisy, start, end, 0, int(random.integers(1, 5)))
        return noisy


def _stations(random: np.random.Generator) -> np.ndarray:
    """Camera positions from 0 to 1, evenly spaced or not."""
    count = int(random.choice([5, 8, 10, 10, 10, 10, 12]))
    if random.random() < 0.5:
        return np.linspace(0.0, 1.0, count)
    inner = np.sort(random.uniform(0.0, 1.0, count - 2))
    return np.concatenate([[0.0], inner, [1.0]])


def _flat_outline(random: np.random.Generator) -> np.ndarray:
    """``(n, 2)`` of about unit size: a star-shaped polygon, with straight or rounded sides."""
    count = int(random.integers(3, 11))
    angles = np.sort(random.uniform(0, 2 * np.pi, count))
    radii = random.uniform(0.25, 1.0, count)
    if random.random() < 0.5:
        fine = np.linspace(0, 2 * np.pi, 90, endpoint=False)
        radii = np.interp(fine, angles, radii, period=2 * np.pi)
        kernel = np.hanning(int(random.integers(5, 25)))
        radii = np.convolve(np.tile(radii, 3), kernel / kernel.sum(), mode="same")[90:180]
        angles = fine
    outline = np.stack([np.cos(angles), np.sin(angles)], axis=1) * radii[:, None]
    outline = outline * [1.0, random.uniform(0.3, 1.0)] @ _rotation(random)[:2, :2]
    return outline / max(float(np.ptp(outline, axis=0).max()), 1e-6)


def _solid(random: np.random.Generator) -> np.ndarray:
    """``(n, 3)`` corners of a convex solid of about unit size in a random pose."""
    kind = random.integers(3)
    if kind == 0:
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    elif kind == 1:
        angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        taper = random.uniform(0.6, 1.0)
        corners = np.concatenate([np.column_stack([ring, np.ones(24)]), np.column_stack([taper * ring, -np.ones(24)])])
    else:
        corners = random.normal(size=(120, 3))
        corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    corners = corners * random.uniform(0.2, 1.0, 3)
    if random.random() < 0.5:  # upright, turned about the image's vertical, as a car or a box on a table
        turn = random.uniform(0, 2 * np.pi)
        c, s = np.cos(turn), np.sin(turn)
        corners = corners @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    else:
        corners = corners @ _rotation(random)
    return corners / max(float(np.ptp(corners[:, :2], axis=0).max()), 1e-6)


def _others(random: np.random.Generator, distance: float, camera: _Camera) -> list[tuple[_Thing, float]]:
    """Other things that are taken for the object, and how often each is."""
    things = []
    for _ in range(int(random.integers(1, 5))):
        away = distance * random.uniform(0.8, 1.5)
        things.append((_Thing.draw(random, away, camera, on_axis=False), random.uniform(0.3, 1.0)))
    return things


def _occluder(random: np.random.Generator, distance: float, target: _Thing, camera: _Camera) -> np.ndarray:
    """``(4, 3)`` a wide plate between camera and object, beside the line of sight of the nearest view."""
    nearer = distance * random.uniform(0.2, 0.9)
    corners = np.concatenate(target.parts)
    extent = np.ptp(corners[:, :2], axis=0)
    side, across = random.choice([-1, 1]), random.integers(2)
    middle = corners[:, :2].mean(axis=0) * nearer / distance
    edge = middle[across] + side * extent[across] * random.uniform(0.3, 0.7)
    far = edge + side * 20 * distance
    wide = 20 * distance
    plate = np.array([[edge, -wide], [edge, wide], [far, wide], [far, -wide]])
    if across == 1:
        plate = plate[:, ::-1]
    return np.column_stack([plate, np.full(4, nearer)])


def _rotation(random: np.random.Generator) -> np.ndarray:
    """A random rotation (3, 3); its upper left block shears a flat outline."""
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    return q * np.sign(np.diag(r))


def _filled(outlines: list[np.ndarray]) -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    for outline in outlines:
        fixed = np.round(np.clip(outline, -4 * WIDTH, 5 * WIDTH) * 2**_shift).astype(np.int32)
        cv2.fillPoly(mask, [fixed.reshape(-1, 1, 2)], 1, shift=_shift)
    return mask


def _ellipse(mask: np.ndarray, centre: np.ndarray, size: np.ndarray, random: np.random.Generator) -> None:
    axes = np.maximum(size, 1.0).astype(int).tolist()
    cv2.ellipse(mask, centre.astype(int).tolist(), axes, random.uniform(0, 180), 0, 360, 1, -1)
