"""The 24 objects of the consecutive trials of VOS-VS (section 7.1, Table 2), built from primitives.

Dimensions and masses are those published for the YCB object set (Calli et al., IEEE Robotics and Automation
Magazine 22(3), 2015); colors follow the originals, prints are noise and patches. Boxes, cans and cups stand, tools
lie.
"""

import numpy as np

from dense_vs.sims.mobile_manipulator.household_object import HouseholdObject
from dense_vs.sims.mobile_manipulator.paint import Paint
from dense_vs.sims.mobile_manipulator.parts import Part, ball, box, cylinder, dish_rim, ring, rod

STEEL = Paint((0.62, 0.63, 0.66), (0.45, 0.46, 0.5), 0.2, 0.9, 0.7)
CHAIN_LENGTH, CHAIN_LINKS, CHAIN_DIAMETER = 1.149, 18, 0.014


def household_objects() -> dict[str, HouseholdObject]:
    """All 24, by name, in the order of Table 2."""
    return {thing.name: thing for thing in [*_tools(), *_food(), *_kitchen(), *_shapes()]}


def _tool_parts() -> tuple[list[Part], ...]:
    """Power drill, padlock, spring clamp, screwdriver, marker."""
    drill = [
        rod((-0.09, 0.03, 0.027), (0.07, 0.03, 0.027), 0.05, rounded=False),
        rod((0.07, 0.03, 0.027), (0.094, 0.03, 0.027), 0.028, paint="metal", rounded=False),
        box(0.045, 0.1, 0.04, at=(-0.05, -0.035, 0.006), paint="grip"),
        box(0.11, 0.04, 0.054, at=(-0.045, -0.1, 0.0), paint="grip"),
    ]
    padlock = [
        box(0.024 * 1.9, 0.04, 0.024, at=(-0.012, 0.0, 0.0)),
        rod((0.01, 0.013, 0.012), (0.036, 0.013, 0.012), 0.008, paint="metal"),
        rod((0.01, -0.013, 0.012), (0.036, -0.013, 0.012), 0.008, paint="metal"),
        rod((0.036, -0.013, 0.012), (0.036, 0.013, 0.012), 0.008, paint="metal"),
    ]
    clamp = [
        rod((-0.05, 0.036, 0.0135), (0.03, 0.008, 0.0135), 0.016),
        rod((-0.05, -0.036, 0.0135), (0.03, -0.008, 0.0135), 0.016),
        box(0.036, 0.034, 0.027, at=(0.004, 0.0, 0.0)),
        box(0.022, 0.014, 0.02, at=(0.052, 0.008, 0.0035), paint="tips"),
        box(0.022, 0.014, 0.02, at=(0.052, -0.008, 0.0035), paint="tips"),
    ]
    screwdriver = [
        rod((-0.098, 0.0, 0.0155), (-0.002, 0.0, 0.0155), 0.031, rounded=False),
        rod((-0.002, 0.0, 0.0155), (0.112, 0.0, 0.0155), 0.007, paint="metal", rounded=False),
    ]
    marker = [
        rod((-0.05, 0.0, 0.009), (0.02, 0.0, 0.009), 0.018, rounded=False),
        rod((0.02, 0.0, 0.009), (0.07, 0.0, 0.009), 0.019, paint="cap", rounded=False),
    ]
    return drill, padlock, clamp, screwdriver, marker


def _tools() -> list[HouseholdObject]:
    drill, padlock, clamp, screwdriver, marker = _tool_parts()
    orange, black = Paint((0.85, 0.36, 0.08), (0.15, 0.12, 0.1), 0.25, 0.3), Paint((0.13, 0.13, 0.14), None, 0, 0.2)
    return [
        HouseholdObject(
            "Power Drill",
            "Tool",
            0.895,
            drill,
            {
                "body": orange,
                "grip": black,
                "metal": STEEL,
            },
            0.05,
            0.054,
        ),
        HouseholdObject(
            "Marker",
            "Tool",
            0.0158,
            marker,
            {
                "body": Paint((0.88, 0.88, 0.9), (0.75, 0.1, 0.12), 0.25, 0.4, 0.5),
                "cap": Paint((0.72, 0.06, 0.1), specular=0.4),
            },
            0.019,
            0.0185,
            True,
        ),
        HouseholdObject(
            "Padlock",
            "Tool",
            0.208,
            padlock,
            {
                "body": Paint((0.75, 0.55, 0.14), (0.62, 0.42, 0.08), 0.2, 0.9, 0.6),
                "metal": STEEL,
            },
            0.04,
            0.024,
        ),
        HouseholdObject(
            "Wood Block",
            "Tool",
            0.729,
            [box(0.2, 0.085, 0.085)],
            {"body": Paint((0.7, 0.42, 0.18), (0.6, 0.33, 0.12), 0.3, 0.25)},
            0.085,
            0.085,
        ),
        HouseholdObject(
            "Spring Clamp",
            "Tool",
            0.059,
            clamp,
            {
                "body": Paint((0.1, 0.1, 0.11), (0.2, 0.2, 0.21), 0.1, 0.3),
                "tips": Paint((0.9, 0.4, 0.1)),
            },
            0.03,
            0.027,
        ),
        HouseholdObject(
            "Screwdriver",
            "Tool",
            0.0984,
            screwdriver,
            {
                "body": Paint((0.8, 0.12, 0.1), (0.1, 0.1, 0.12), 0.3, 0.5),
                "metal": STEEL,
            },
            0.031,
            0.031,
            True,
        ),
    ]


def _food_parts() -> tuple[list[Part], ...]:
    """Plastic banana, tuna, chips can."""
    angles = np.linspace(-0.75, 0.75, 7)
    arc = [(0.115 * np.sin(a), 0.115 * (np.cos(a) - 0.82), 0.017) for a in angles]
    widths = [0.024, 0.032, 0.034, 0.034, 0.032, 0.024]
    banana = [rod(arc[k], arc[k + 1], widths[k]) for k in range(6)]
    banana.append(rod(arc[6], (arc[6][0] + 0.014, arc[6][1] - 0.016, 0.018), 0.012, paint="stem"))
    tuna = [cylinder(0.085, 0.029, at=(0, 0, 0.002)), cylinder(0.082, 0.033, paint="lid")]
    chips = [cylinder(0.075, 0.244, at=(0, 0, 0.0)), cylinder(0.072, 0.25, paint="lid")]
    return banana, tuna, chips


def _food() -> list[HouseholdObject]:
    banana, tuna, chips = _food_parts()
    return [
        HouseholdObject(
            "Chips Can",
            "Food",
            0.205,
            chips,
            {
                "body": Paint((0.72, 0.1, 0.1), (0.9, 0.75, 0.2), 0.3, 0.5),
                "lid": Paint((0.75, 0.12, 0.1), (0.9, 0.3, 0.2), 0.2, 0.4),
            },
            0.075,
            0.25,
        ),
        HouseholdObject(
            "Potted Meat",
            "Food",
            0.37,
            [box(0.097, 0.05, 0.082)],
            {"body": Paint((0.12, 0.2, 0.5), (0.9, 0.85, 0.3), 0.35, 0.6, 0.5)},
            0.05,
            0.082,
        ),
        HouseholdObject(
            "Plastic Banana",
            "Food",
            0.066,
            banana,
            {
                "body": Paint((0.88, 0.76, 0.14), (0.8, 0.66, 0.1), 0.2, 0.3),
                "stem": Paint((0.4, 0.32, 0.1)),
            },
            0.036,
            0.034,
            True,
        ),
        HouseholdObject(
            "Box of Sugar",
            "Food",
            0.514,
            [box(0.089, 0.038, 0.175)],
            {"body": Paint((0.92, 0.82, 0.2), (0.96, 0.95, 0.92), 0.4, 0.1)},
            0.038,
            0.175,
        ),
        HouseholdObject(
            "Tuna",
            "Food",
            0.171,
            tuna,
            {
                "body": Paint((0.15, 0.3, 0.6), (0.85, 0.85, 0.2), 0.3, 0.6),
                "lid": Paint((0.55, 0.6, 0.7), (0.2, 0.35, 0.6), 0.3, 0.9, 0.6),
            },
            0.085,
            0.033,
        ),
        HouseholdObject(
            "Gelatin",
            "Food",
            0.097,
            [box(0.085, 0.073, 0.028)],
            {"body": Paint((0.8, 0.16, 0.2), (0.95, 0.9, 0.85), 0.35, 0.1)},
            0.073,
            0.028,
        ),
    ]


def _kitchen_parts() -> tuple[list[Part], ...]:
    """Mug, bottle of Softscrub, skillet with lid, plate, spatula, knife."""
    mug = [*ring(0.082, 0.074, 0.082, sides=20), cylinder(0.078, 0.006, paint="inside")]
    mug += [
        rod((0.04, 0.0, 0.066), (0.06, 0.0, 0.062), 0.01),
        rod((0.06, 0.0, 0.062), (0.06, 0.0, 0.026), 0.01),
        rod((0.06, 0.0, 0.026), (0.04, 0.0, 0.018), 0.01),
    ]
    bottle = [
        box(0.098, 0.065, 0.17),
        box(0.07, 0.052, 0.05, at=(0.0, 0.0, 0.17)),
        cylinder(0.036, 0.03, at=(0.0, 0.0, 0.22), paint="cap"),
    ]
    skillet = [
        cylinder(0.27, 0.025, at=(-0.1, 0.0, 0.0)),
        cylinder(0.262, 0.01, at=(-0.1, 0.0, 0.025), paint="lid"),
        cylinder(0.035, 0.022, at=(-0.1, 0.0, 0.035), paint="knob"),
        box(0.2, 0.028, 0.014, at=(0.135, 0.0, 0.014), paint="knob"),
    ]
    plate = [cylinder(0.16, 0.006), *dish_rim(), cylinder(0.15, 0.0065, paint="inside")]
    spatula = [
        rod((-0.165, 0.0, 0.027), (0.08, 0.0, 0.012), 0.016, paint="handle"),
        box(0.1, 0.083, 0.004, at=(0.125, 0.0, 0.003)),
        box(0.006, 0.083, 0.012, at=(0.172, 0.0, 0.003)),
    ]
    knife = [
        rod((-0.098, 0.0, 0.0075), (-0.005, 0.0, 0.0075), 0.015, paint="handle"),
        box(0.112, 0.02, 0.002, at=(0.052, 0.0, 0.006)),
    ]
    return mug, bottle, skillet, plate, spatula, knife


def _kitchen() -> list[HouseholdObject]:
    mug, bottle, skillet, plate, spatula, knife = _kitchen_parts()
    return [
        HouseholdObject(
            "Mug",
            "Kitchen",
            0.118,
            mug,
            {
                "body": Paint((0.66, 0.1, 0.12), (0.6, 0.08, 0.1), 0.2, 0.8, 0.6),
                "inside": Paint((0.6, 0.1, 0.12), specular=0.5),
            },
            0.082,
            0.082,
        ),
        HouseholdObject(
            "Softscrub",
            "Kitchen",
            1.131,
            bottle,
            {
                "body": Paint((0.9, 0.9, 0.92), (0.2, 0.35, 0.7), 0.3, 0.4),
                "cap": Paint((0.15, 0.3, 0.65), specular=0.4),
            },
            0.036,
            0.25,
        ),
        HouseholdObject(
            "Skillet with Lid",
            "Kitchen",
            1.6,
            skillet,
            {
                "body": Paint((0.1, 0.1, 0.11), specular=0.6),
                "lid": Paint((0.28, 0.3, 0.34), (0.2, 0.21, 0.24), 0.3, 0.9, 0.7),
                "knob": Paint((0.06, 0.06, 0.07), specular=0.5),
            },
            0.27,
            0.057,
        ),
        HouseholdObject(
            "Plate",
            "Kitchen",
            0.279,
            plate,
            {
                "body": Paint((0.7, 0.12, 0.12), (0.62, 0.08, 0.1), 0.2, 0.9, 0.6),
                "inside": Paint((0.74, 0.16, 0.14), specular=0.9),
            },
            0.258,
            0.024,
        ),
        HouseholdObject(
            "Spatula",
            "Kitchen",
            0.0515,
            spatula,
            {
                "body": Paint((0.12, 0.12, 0.13), (0.18, 0.18, 0.2), 0.2, 0.3),
                "handle": Paint((0.7, 0.1, 0.12), (0.1, 0.1, 0.1), 0.2, 0.4),
            },
            0.016,
            0.035,
        ),
        HouseholdObject(
            "Knife",
            "Kitchen",
            0.031,
            knife,
            {
                "body": STEEL,
                "handle": Paint((0.68, 0.08, 0.1), specular=0.4),
            },
            0.015,
            0.015,
        ),
    ]


def _shapes() -> list[HouseholdObject]:
    washer = ring(0.048, 0.018, 0.004, sides=14)
    cup = [*ring(0.08, 0.074, 0.07, sides=20), cylinder(0.076, 0.004, paint="inside")]
    return [
        HouseholdObject(
            "Baseball",
            "Shape",
            0.148,
            [ball(0.075)],
            {"body": Paint((0.9, 0.89, 0.85), (0.75, 0.15, 0.12), 0.08, 0.15)},
            0.075,
            0.075,
            True,
        ),
        HouseholdObject(
            "Plastic Chain",
            "Shape",
            0.098,
            [],
            {"body": Paint((0.92, 0.8, 0.1), (0.8, 0.66, 0.05), 0.15, 0.3)},
            0.05,
            CHAIN_DIAMETER,
            links=CHAIN_LINKS,
        ),
        HouseholdObject(
            "Washer",
            "Shape",
            0.048,
            washer,
            {"body": STEEL},
            0.048,
            0.004,
        ),
        HouseholdObject(
            "Stacking Cup",
            "Shape",
            0.026,
            cup,
            {
                "body": Paint((0.15, 0.62, 0.3), (0.1, 0.5, 0.24), 0.2, 0.3),
                "inside": Paint((0.12, 0.5, 0.26)),
            },
            0.08,
            0.07,
        ),
        HouseholdObject(
            "Dice",
            "Shape",
            0.0052,
            [box(0.0162, 0.0162, 0.0162)],
            {"body": Paint((0.42, 0.16, 0.62), (0.98, 0.95, 0.95), 0.12, 0.4)},
            0.0162,
            0.0162,
        ),
        HouseholdObject(
            "Foam Brick",
            "Shape",
            0.028,
            [box(0.078, 0.053, 0.051)],
            {"body": Paint((0.72, 0.26, 0.2), (0.62, 0.2, 0.15), 0.2, 0.02)},
            0.053,
            0.051,
        ),
    ]
