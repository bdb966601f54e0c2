"""Things that lie about: none of them is an object of the trials, some resemble one in color or shape.

Segmenters learn among the first half of them and are asked among the other, so that no clutter is known to them.
"""

from dense_vs.sims.mobile_manipulator.household_object import HouseholdObject
from dense_vs.sims.mobile_manipulator.paint import Paint
from dense_vs.sims.mobile_manipulator.parts import Part, ball, box, cylinder, ring, rod


def clutter_objects() -> dict[str, HouseholdObject]:
    """All of them, by name."""
    return {thing.name: thing for thing in [*_learned_among(), *_met_in_trials()]}


def clutter_learned_among() -> tuple[str, ...]:
    """Names of those that stand about in the images that segmenters learn from."""
    return tuple(thing.name for thing in _learned_among())


def clutter_met_in_trials() -> tuple[str, ...]:
    """Names of those that stand about in trials."""
    return tuple(thing.name for thing in _met_in_trials())


def _thing(name: str, mass: float, parts: list[Part], paint: Paint, grip: float, height: float, rolls: bool = False):
    return HouseholdObject(name, "Clutter", mass, parts, {"body": paint}, grip, height, rolls)


def _learned_among() -> list[HouseholdObject]:
    return [
        _thing("Notebook", 0.2, [box(0.15, 0.1, 0.012)], Paint((0.2, 0.3, 0.62), (0.85, 0.85, 0.8), 0.15), 0.1, 0.012),
        _thing("Candle", 0.1, [cylinder(0.05, 0.06)], Paint((0.9, 0.86, 0.74), (0.8, 0.74, 0.6), 0.2), 0.05, 0.06),
        _thing("Apple", 0.07, [ball(0.07)], Paint((0.75, 0.14, 0.12), (0.85, 0.6, 0.2), 0.2, 0.3), 0.07, 0.07, True),
        _thing("Tape Roll", 0.05, ring(0.09, 0.05, 0.03), Paint((0.6, 0.48, 0.3), (0.5, 0.4, 0.25)), 0.09, 0.03),
        _thing(
            "Glue Stick",
            0.03,
            [rod((-0.05, 0, 0.013), (0.05, 0, 0.013), 0.026, rounded=False)],
            Paint((0.95, 0.75, 0.12), (0.1, 0.1, 0.1), 0.25),
            0.026,
            0.026,
            rolls=True,
        ),
        _thing("Toy Block", 0.04, [box(0.06, 0.06, 0.06)], Paint((0.15, 0.55, 0.3), (0.9, 0.9, 0.85), 0.2), 0.06, 0.06),
    ]


def _met_in_trials() -> list[HouseholdObject]:
    stapler = [box(0.13, 0.035, 0.02), box(0.11, 0.03, 0.025, at=(0.0, 0.0, 0.02))]
    return [
        _thing("Stapler", 0.15, stapler, Paint((0.62, 0.1, 0.1), (0.15, 0.15, 0.16), 0.25, 0.3), 0.035, 0.045),
        _thing(
            "Soap Bar", 0.1, [box(0.085, 0.055, 0.028)], Paint((0.82, 0.75, 0.85), (0.7, 0.6, 0.78), 0.3), 0.055, 0.028
        ),
        _thing(
            "Pill Bottle",
            0.05,
            [cylinder(0.045, 0.075)],
            Paint((0.85, 0.45, 0.1), (0.92, 0.92, 0.9), 0.35),
            0.045,
            0.075,
        ),
        _thing(
            "Jar Lid", 0.03, [cylinder(0.07, 0.014)], Paint((0.55, 0.56, 0.6), (0.4, 0.4, 0.45), 0.2, 0.7), 0.07, 0.014
        ),
        _thing("Lime", 0.06, [ball(0.055)], Paint((0.45, 0.62, 0.14), (0.35, 0.52, 0.1), 0.3), 0.055, 0.055, True),
        _thing(
            "Paperback", 0.15, [box(0.11, 0.075, 0.018)], Paint((0.85, 0.78, 0.2), (0.2, 0.25, 0.5), 0.3), 0.075, 0.018
        ),
    ]
