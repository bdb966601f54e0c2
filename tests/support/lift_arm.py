"""An arm of which some joints slide, as an MJCF file with a texture of its own on every geom."""

from pathlib import Path
from xml.etree import ElementTree

import cv2
import mujoco
import numpy as np

from dense_vs.sims.engine.textures import ROBOT_PAINT, SCENERY_PAINT, noise_texture, texture_size

MODEL = Path(__file__).with_name("lift_arm.xml")
TEXEL = 0.0038  # m
# Kind, axis and damping of a joint in place of the file's own.
SLIDE = {"type": "slide", "range": "-0.1 0.1", "damping": "400"}
LAYOUTS = {
    "lift": {},
    "telescope": {
        "lift": {"type": "hinge", "axis": "0 0 1", "range": "-0.5 0.5", "damping": "86"},
        "elbow": SLIDE | {"axis": "0 0 1"},
    },
    "gantry": {"lift": {"axis": "1 0 0.2"}, "shoulder": SLIDE | {"axis": "-0.6 0.4 0.6"}},
}
SLIDES = {"lift": (True, False, False), "telescope": (False, False, True), "gantry": (True, True, False)}


def write_lift_arm(folder: Path, layout: str = "lift", seed: int = 0) -> Path:
    """Write the model of one of :data:`LAYOUTS`, painted by a seed; its file."""
    rng = np.random.default_rng([seed, 5])
    tree = ElementTree.parse(MODEL)
    root = tree.getroot()
    for name, changes in LAYOUTS[layout].items():
        joint, motor = root.find(f".//joint[@name='{name}']"), root.find(f".//actuator/position[@joint='{name}']")
        assert joint is not None
        assert motor is not None
        joint.attrib |= changes
        motor.set("kp", "8000" if joint.get("type") == "slide" else "4000")
    assets = ElementTree.SubElement(root, "asset")
    spec = mujoco.MjSpec.from_file(str(MODEL))
    for geom in root.iter("geom"):
        name = geom.get("name")
        if name is None:
            continue
        one = spec.geom(name)
        paint = SCENERY_PAINT if one.parent.name == "world" else ROBOT_PAINT
        height, width = texture_size(one.type, one.size, TEXEL * paint.texel)
        color = np.clip(one.rgba[:3] + rng.uniform(-0.1, 0.1, 3), 0.2, 0.75)
        file = folder / f"{name}.png"
        cv2.imwrite(str(file), noise_texture(rng, height, width, color, paint))
        ElementTree.SubElement(assets, "texture", {"name": name, "type": "2d", "file": str(file)})
        ElementTree.SubElement(assets, "material", {"name": name, "texture": name, "specular": "0"})
        geom.set("material", name)
        geom.attrib.pop("rgba")
    path = folder / f"{layout}.xml"
    tree.write(path)
    return path
