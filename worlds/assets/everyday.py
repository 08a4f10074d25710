"""How big and how heavy is an everyday object of each category?

Imported models carry no mass and often no unit of length; what is supplied instead stands here. Sizes are those of
shop catalogues, rounded; densities are total mass over the volume of the convex parts that stand for the object, so
that an everyday instance weighs what the docstrings say.
"""

from __future__ import annotations

from dataclasses import dataclass

from worlds.tasks import ARTICULATED, TASKS

CATEGORIES: tuple[str, ...] = tuple(dict.fromkeys(task.objects for task in TASKS.values()))
"""Every category of objects that a task uses."""

WIDEST_GRIP = 0.070
"""What the hand closes around may be no wider [m]: it opens 80 mm."""

MOST_MASS = 1.0
"""An object may weigh no more [kg]: two pads that press with 40 N at friction 0.8 carry 64 N, less what a grip at the
rim spends on the object's leverage."""

MODEL_SPAN = (0.4, 2.0)
"""A metric model is taken as it is when its size over the everyday size is in this range, else it is scaled: it is a
miniature, a full-size window, or its unit was not the metre."""


@dataclass(frozen=True, slots=True)
class Everyday:
    """The everyday instance of a category.

    Attributes:
        size: Its longest side, or its height for ``Bottle`` and ``Dispenser`` [m].
        density: Mass over the volume of the body's convex parts [kg/m^3].
        lies: Whether it rests on its broad side.
        hollow: Whether its inside must stay open.
        hinge: Resistance of a hinge that is not the functional joint [N m].
    """

    size: float
    density: float
    lies: bool = True
    hollow: bool = False
    hinge: float = 0.05


EVERYDAY: dict[str, Everyday] = {
    # A partly full container; drink bottles are 0.20 to 0.24, soap dispensers 0.18 to 0.20.
    "Bottle": Everyday(0.22, 250.0, lies=False),
    "Dispenser": Everyday(0.19, 250.0, lies=False),
    # Disposable and kitchen lighters.
    "Lighter": Everyday(0.080, 1000.0, lies=False),
    # Ballpoint pens and markers, 0.135 to 0.150, 10 to 20 g.
    "Pen-Button": Everyday(0.14, 1000.0, lies=False),
    "Pen-Cap": Everyday(0.14, 1000.0, lies=False),
    # Combination pliers of 160 to 200 mm, 200 to 300 g of steel; the hulls hold air.
    "Pliers": Everyday(0.18, 3000.0, lies=True, hinge=0.1),
    # Desk staplers of 120 to 160 mm, 150 to 250 g.
    "Stapler": Everyday(0.14, 1200.0, lies=False, hinge=0.1),
    # Capped sticks of 55 to 75 mm, 10 to 20 g.
    "USB": Everyday(0.070, 1200.0, lies=False),
    # Cereal bowls of 140 to 160 mm, 300 to 400 g of ceramic.
    "Bowl": Everyday(0.15, 1800.0, lies=False, hollow=True),
    # A baseball cap with its peak is 0.25 to 0.29 long and weighs 70 to 100 g; its parts are thicker than cloth.
    "Cap": Everyday(0.27, 80.0, lies=False, hollow=True),
    # Compact keyboards of 0.36 to 0.42, 400 to 600 g.
    "Keyboard": Everyday(0.40, 500.0),
    # Closed 12 and 13 inch laptops are 0.28 to 0.31 wide and weigh 0.9 to 1.3 kg; hinges hold 0.3 to 0.9 N m.
    "Laptop": Everyday(0.30, 800.0, hinge=0.5),
    # 0.14 to 0.16 long, 150 to 200 g.
    "Phone": Everyday(0.15, 1700.0),
    # Television remotes of 0.15 to 0.20, 80 to 130 g with batteries.
    "Remote": Everyday(0.17, 800.0),
    # Household scissors of 0.15 to 0.20, 50 to 100 g; their parts are fuller than blades and rings; a tight screw.
    "Scissors": Everyday(0.17, 1500.0, hinge=0.1),
    # Wall switches with an 80 to 86 mm plate, 60 to 100 g, half air.
    "Switch": Everyday(0.086, 700.0),
    # A model of a window, of light wood and acrylic: full-size ones are 0.6 to 1.3 m.
    "Window": Everyday(0.28, 300.0, hinge=0.3),
    # Dessert plates of 0.19 to 0.23, 350 to 450 g of ceramic.
    "Plate": Everyday(0.21, 2000.0, lies=False, hollow=True),
}
"""By object category."""


def needs_part(category: str) -> bool:
    """Whether the tasks of an object category operate a part of it."""
    return category in ARTICULATED


def density_for(category: str, volume: float) -> tuple[float, tuple[str, ...]]:
    """Density [kg/m^3] for parts of ``volume`` [m^3], lowered where they would outweigh ``MOST_MASS``, and a note."""
    usual = EVERYDAY[category].density
    if usual * volume <= MOST_MASS:
        return usual, (f"mass supplied: {usual:g} kg/m^3 of its convex parts",)
    lowered = MOST_MASS / volume
    return lowered, (f"mass supplied: {lowered:.0f} kg/m^3, not {usual:g}, to weigh {MOST_MASS:g} kg",)
