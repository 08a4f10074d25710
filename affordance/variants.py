"""Which learned proposers are there: whose weights does each read, and which part of the whole does it go without?"""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Literal

from msgspec import Struct

from robots.errors import UnknownName


class Variant(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One way to propose with networks."""

    weights: str = "learned"
    """Name of the shipped file of weights."""
    ranked: bool = True
    """Whether critics rank what the actors draw; else only the affordance of the point counts."""
    feasibility: bool = True
    """Whether the feasibility critic takes part in the ranking."""
    reorient: Literal["rigid", "actor"] = "rigid"
    """Whether the hand follows the object's pose by geometry, or where the Reorient Actor says."""
    prepares: bool = True
    """Whether an assistant prepares; else one arm acts on the object as it lies, as Where2Act does."""
    first_only: bool = False
    """Whether only the best candidate is given, as the paper does: nothing is resampled."""


VARIANTS: dict[str, Variant] = {
    "learned": Variant(),
    "learned-paper": Variant(feasibility=False, reorient="actor", first_only=True),
    "no_ant_aff": Variant(weights="no_ant_aff"),
    "no_obj_pose": Variant(weights="no_obj_pose", reorient="actor"),
    "w2a": Variant(prepares=False),
    "no_critic": Variant(ranked=False),
    "no_feasibility": Variant(feasibility=False),
    "actor_reorient": Variant(reorient="actor"),
}
"""Learned proposers by name, as given to ``--proposer``."""


def variant_of(name: str) -> Variant:
    """The variant of that name; ``UnknownName`` when there is none."""
    if name not in VARIANTS:
        raise UnknownName("learned proposer", name, VARIANTS)
    return VARIANTS[name]


def shipped_weights(variant: Variant) -> Path:
    """Where the weights of a variant are."""
    return Path(str(resources.files("affordance"))) / "weights" / f"{variant.weights}.safetensors"
