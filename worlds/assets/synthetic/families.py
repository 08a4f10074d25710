"""Which families of objects can be generated?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from worlds.assets.asset import Asset
from worlds.assets.synthetic import (
    bottle,
    bowl,
    cap,
    dispenser,
    keyboard,
    laptop,
    lighter,
    pen,
    phone,
    plate,
    pliers,
    remote,
    scissors,
    stapler,
    switch,
    usb,
    window,
)
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
        Family(stapler.SERIES, stapler.make),
        Family(usb.SERIES, usb.make),
        Family(bowl.SERIES, bowl.make),
        Family(cap.SERIES, cap.make),
        Family(keyboard.SERIES, keyboard.make),
        Family(laptop.SERIES, laptop.make),
        Family(phone.SERIES, phone.make),
        Family(plate.SERIES, plate.make),
        Family(pliers.SERIES, pliers.make),
        Family(remote.SERIES, remote.make),
        Family(scissors.SERIES, scissors.make),
        Family(switch.SERIES, switch.make),
        Family(window.SERIES, window.make),
    )
}
"""By object category: those that are operated, then those that are pushed over an edge."""
