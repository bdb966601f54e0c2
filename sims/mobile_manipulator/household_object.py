"""A household object of the simulated scenes: its parts, their paints, and the width that a gripper meets."""

from dataclasses import dataclass, field

from dense_vs.sims.mobile_manipulator.paint import Paint
from dense_vs.sims.mobile_manipulator.parts import Part


@dataclass(frozen=True)
class HouseholdObject:
    """One object.

    Attributes:
        name: as in Table 2.
        category: Tool, Food, Kitchen or Shape.
        mass: [kg].
        parts: its geoms.
        paints: paint of each name that the parts use.
        grip: smallest width across it that a gripper from above has to span [m].
        height: above what it rests on [m].
        rolls: whether it needs rolling friction to rest.
    """

    name: str
    category: str
    mass: float
    parts: list[Part]
    paints: dict[str, Paint]
    grip: float
    height: float
    rolls: bool = False
    links: int = field(default=0)  # of a chain, whose parts are made link by link

    @property
    def body(self) -> str:
        """Name of its body in the model."""
        return self.name.lower().replace(" ", "_")
