"""Which families of objects can be generated?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from worlds.assets.asset import Asset
from worlds.assets.synthetic import bottle, dispenser, lighter, pen, plate, pliers, stapler, usb
from worlds.assets.synthetic.series import Series


@dataclass(frozen=True, slots=True)
class Family:
    """A numbered series and how one of its instances is made."""

    series: Series
    make: Callable[[str], Asset]


FAMILIES: dict[str, Family] = {
    family.series.category: family
    for family in (
        Family(bottle.SERIES, bottle.make),
        Family(dispenser.SERIES, dispenser.make),
        Family(lighter.SERIES, lighter.make),
        Family(pen.BUTTON, pen.make_button),
        Family(pen.CAP, pen.make_cap),
        Family(plate.SERIES, plate.make),
        Family(pliers.SERIES, pliers.make),
        Family(stapler.SERIES, stapler.make),
        Family(usb.SERIES, usb.make),
    )
}
"""By object category."""
