"""Square markers of OpenCV's ArUco dictionary: painted on a model's plates, and found again in images.

Every geom whose name ends in ``marker_<id>`` shows that marker on its +z side with a white margin of one cell. The
features are a marker's four corners; feature 4 k + c is corner c of the k-th marker asked for.
"""

from collections.abc import Sequence
from functools import cache

import cv2
import mujoco
import numpy as np

PREFIX = "marker_"
_CELLS = 6  # a marker of 4 x 4 bits with its black border
_REACH = 2.0  # px to either side of an edge that is searched
_REFINEMENTS = 2
_STRAIGHT = 0.25  # px, root mean square of an edge about its line: more is no marker's edge
_ENLARGED = 2  # finds markers seen at a slant, whose bits are 2 px wide
_TEXELS = 32  # a cell; the renderer blends neighboring texels, which blurs an edge by less than a hundredth of a cell


def paint_markers(spec: mujoco.MjSpec) -> None:
    """Give every geom whose name ends in ``marker_<id>`` its marker as a texture, in place."""
    for geom in spec.geoms:
        name = geom.name.rsplit("/", 1)[-1]
        if not name.startswith(PREFIX):
            continue
        side = _CELLS * _TEXELS
        image = cv2.aruco.generateImageMarker(_dictionary(), int(name.removeprefix(PREFIX)), side)
        image = np.pad(image, _TEXELS, constant_values=255)
        texture = spec.add_texture(
            name=geom.name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=image.shape[1], height=image.shape[0], nchannel=3
        )
        texture.data = np.repeat(image[..., None], 3, axis=2).tobytes()
        material = spec.add_material(name=geom.name, specular=0.0)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = geom.name
        geom.material = geom.name
        geom.rgba = [0.5, 0.5, 0.5, 1.0]  # MuJoCo's mark for "the material decides"


def find_corners(image: np.ndarray, markers: Sequence[int]) -> np.ndarray:
    """Corners (4 * len(markers), 2) [px] of the markers in a color image (H, W, 3) uint8; NaN where not found.

    Pixel centers are at integer coordinates. Corners are where lines fitted to the marker's four edges cross: OpenCV's
    own refinements are off by 0.3 to 1 px at markers of 20 px, in directions that change with the view.
    """
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    enlarged = cv2.resize(gray, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_CUBIC)
    corners, ids, _ = _detector().detectMarkers(enlarged)
    found = np.full((len(markers), 4, 2), np.nan)
    for quad, marker in zip(corners, [] if ids is None else np.ravel(ids), strict=True):
        if int(marker) in markers:
            found[list(markers).index(int(marker))] = _refined(gray, (quad[0] + 0.5) / _ENLARGED - 0.5)
    return found.reshape(-1, 2)


def _refined(gray: np.ndarray, quad: np.ndarray) -> np.ndarray:
    """Corners (4, 2) of the quadrilateral whose sides lie on the edge from dark to bright near those of ``quad``."""
    for _ in range(_REFINEMENTS):
        lines = np.array([_edge_line(gray, quad[k], quad[(k + 1) % 4]) for k in range(4)])
        if not np.all(np.isfinite(lines)):
            return np.full((4, 2), np.nan)
        crossings = np.cross(np.roll(lines, 1, axis=0), lines)  # homogeneous points
        refined = crossings[:, :2] / crossings[:, 2:]
        if not np.all(np.abs(refined - quad) < _REACH):  # ran off along something else
            return np.full((4, 2), np.nan)
        quad = refined
    return quad


def _edge_line(gray: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Homogeneous line (3,) through the edge between two corners, dark on its inner side; NaN where there is none."""
    along = second - first
    length = float(np.hypot(*along))
    normal = np.array([along[1], -along[0]]) / max(length, 1e-9)  # outwards: the detector's corners go clockwise
    share = np.linspace(0.12, 0.88, max(8, round(1.5 * length)))
    offsets = np.arange(-_REACH, _REACH + 1e-9, 0.25)
    places = (first + share[:, None] * along)[:, None] + offsets[:, None] * normal
    across_x, across_y = np.moveaxis(places.astype(np.float32), 2, 0)
    profile = cv2.remap(gray, across_x, across_y, cv2.INTER_LINEAR).astype(np.float64)
    slope = np.clip(np.diff(profile, axis=1), 0.0, None)  # brighter outwards is the edge; anything else is not
    slope[slope < 0.06 * slope.max(axis=1, keepdims=True)] = 0.0
    weight = slope.sum(axis=1)
    good = weight > 0.5 * np.median(weight)
    if good.sum() < 4 or np.median(weight) <= 0.0:
        return np.full(3, np.nan)
    middle = 0.5 * (offsets[1:] + offsets[:-1])
    shift = (slope[good] @ middle) / weight[good]
    points = (first + share[good, None] * along) + shift[:, None] * normal
    line, off = _line_through(points)
    line, off = _line_through(points[off <= max(2.5 * np.median(off), 0.02)])
    return line if np.sqrt(np.mean(off**2)) <= _STRAIGHT else np.full(3, np.nan)


def _line_through(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Homogeneous line (3,) of least squares through points (k, 2), and their distances from it."""
    center = points.mean(axis=0)
    direction = np.linalg.svd(points - center)[2][0]
    normal = np.array([direction[1], -direction[0]])
    return np.append(normal, -normal @ center), np.abs((points - center) @ normal)


@cache
def _dictionary() -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)


@cache
def _detector() -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    parameters.minMarkerPerimeterRate = 0.02
    parameters.perspectiveRemovePixelPerCell = 8
    parameters.perspectiveRemoveIgnoredMarginPerCell = 0.3
    return cv2.aruco.ArucoDetector(_dictionary(), parameters)
