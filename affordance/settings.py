"""Which networks are built and how their losses are weighted: every hyper-parameter, in one table that is also a file.

Nothing here needs torch, so a command line can offer the choices without loading it.
"""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

from robots.errors import UnknownName

SCALE = 0.25
"""Length that is one to the networks [m]: about a desk object's largest half extent."""

RADII = (0.1, 0.2, 0.4, 0.8)
"""Ball radii of the four levels in units of ``SCALE``: 25, 50, 100 and 200 mm, the sizes of a finger,
a hand, a desk object and all of it. Where2Act's radii are the same numbers for objects of about a metre."""

NEIGHBOURS = 32
"""Points of a ball that are looked at, the nearest first; Where2Act's number."""


class Profile(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How many points are looked at."""

    points: int
    """Points of a cloud."""
    centres: tuple[int, int, int, int]
    """Points that are left after each level."""
    radii: tuple[float, float, float, float] = RADII
    neighbours: int = NEIGHBOURS


class Weights(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Weights of the parts of a generative head's loss."""

    angle: float
    """Of the geodesic angle [1 / rad]."""
    kl: float
    """Of the Kullback-Leibler divergence from the prior, after the warm-up."""
    shift: float = 0.0
    """Of the mean absolute error of the translation, in units of ``SCALE``; orientations have none."""


class Losses(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How predictions are judged in training."""

    orientation: Weights
    """Of both grippers' orientations."""
    pose: Weights
    """Of the object's motion and the hand's."""
    w_orientation: float = 1.0
    w_pose: float = 1.0
    w_opening: float = 1.0
    w_reach: float = 4.0
    """Of where the finger tips are; an error of 10 mm is 0.04 in units of ``SCALE``."""
    w_operation: float = 1.0
    w_push: float = 1.0
    w_place: float = 1.0
    """Of where hands act; a chance of a tenth costs 2.3."""
    w_sort: float = 2.0
    """Of what can be done there."""
    w_affordance: float = 1.0
    w_critic: float = 1.0
    w_feasibility: float = 1.0
    geodesic: Literal["atan2", "arccos"] = "atan2"
    """``arccos`` is the paper's formula, clamped, whose gradient vanishes near 0 and pi."""
    flip: bool = True
    """Whether a hand turned by half a turn about its approach counts as the same hand: two equal fingers."""
    kl_warmup: int = 500
    """Steps over which the weight of the divergence rises from zero."""
    draws: int = 100
    """Actions drawn at a point whose affordance is wanted."""
    top: int = 10
    """Of these, those with the best outlook, whose mean is the point's affordance."""
    own_critic_encoder: bool = True
    """Whether critics see through an encoder of their own, so that their losses do not reach the actors' one."""
    pose_critic: bool = True
    """Whether object poses have a critic, which the paper does not have."""
    enough: float = 0.7
    """Quantile of the amounts of motion that is learned: too little never opens a part, more is stopped by a force."""
    label_every: int = 3
    """Steps between two in which affordances are labelled and learned, which costs as much as all the rest."""
    zero_latent: bool = False
    """Whether poses are predicted with the latent at zero instead of drawn."""


class Training(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How the weights are fitted."""

    steps: int = 30_000
    batch: int = 32
    rate: float = 1e-3
    """Learning rate of Adam at the beginning; all of the field's forerunners use it."""
    last_rate: float = 1e-5
    """At the end of a cosine."""
    weight_decay: float = 1e-5
    clip: float = 1.0
    """Largest norm of the gradient."""
    average: float = 0.998
    """Decay of the running mean of the weights that label affordances."""
    bf16: bool = False
    """Whether the encoders' layers compute in bfloat16 on a CPU as well: half the time where it has AVX-512 BF16 or
    AMX, longer where it has neither."""
    dropout: float = 0.1
    """Share of rows whose goal action is hidden from the networks that follow it."""


class Settings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Everything that decides what a model is and how it is trained; stands in the header of its file."""

    profile: Profile
    losses: Losses
    training: Training = Training()
    head: Literal["cvae", "flow"] = "cvae"
    """Which kind of generative head draws orientations and poses."""
    latent: int = 32
    """Dimensions of a cVAE's latent; a flow starts from noise of its own output's size."""
    euler_steps: int = 10
    """Steps in which a flow is integrated."""
    anticipation: bool = True
    """``False``: the ablation without anticipatory affordance, which never shows the goal to the preparing arm."""
    object_pose: bool = True
    """``False``: the ablation without object pose predictor, whose reorientation sees both actions instead."""


PROFILES: dict[str, Profile] = {
    "paper": Profile(points=8192, centres=(1024, 256, 64, 16)),
    "default": Profile(points=2048, centres=(512, 128, 32, 16)),
    "cpu": Profile(points=1024, centres=(256, 64, 32, 16)),
    "shipped": Profile(points=512, centres=(128, 48, 16, 6), neighbours=16),
    "test": Profile(points=256, centres=(64, 32, 16, 8)),
}
"""Sizes of a cloud by name."""

TUNED = Weights(angle=1.0, kl=0.2)
"""On a toy with two modes, this divergence weight left 9 % of the prior's samples off both modes after 6000 steps;
DualAfford's and BiAssembly's, 0.02 to 5 and 0.002 to 1, left more than half."""

TUNED_POSE = Weights(angle=1.0, kl=0.1, shift=1.0)

PRESETS: dict[str, Losses] = {
    "default": Losses(orientation=TUNED, pose=TUNED_POSE),
    # DualAfford (sxy7147/DualAfford), the work of one of the paper's authors: affordance is the mean of all draws.
    "sxy": Losses(
        orientation=Weights(angle=5.0, kl=0.02),
        pose=TUNED_POSE,
        geodesic="arccos",
        flip=False,
        kl_warmup=0,
        top=100,
        pose_critic=False,
    ),
    # BiAssembly (sxy7147/BiAssembly), the code closest to the paper: one encoder for all, maps and critics at 0.01.
    "biassembly": Losses(
        orientation=Weights(angle=1.0, kl=0.002),
        pose=Weights(angle=10.0, kl=0.02, shift=1.0),
        w_affordance=0.01,
        w_critic=0.01,
        geodesic="arccos",
        flip=False,
        kl_warmup=0,
        own_critic_encoder=False,
        pose_critic=False,
        zero_latent=True,
    ),
    # The paper's equations as printed, which weight every term alike.
    "printed": Losses(
        orientation=Weights(angle=1.0, kl=1.0),
        pose=Weights(angle=1.0, kl=1.0, shift=1.0),
        geodesic="arccos",
        flip=False,
        kl_warmup=0,
        pose_critic=False,
    ),
}
"""Weights of the losses by name."""


def profile_of(name: str) -> Profile:
    """The sizes of that name; ``UnknownName`` when there are none."""
    if name not in PROFILES:
        raise UnknownName("network profile", name, PROFILES)
    return PROFILES[name]


def losses_of(name: str) -> Losses:
    """The weights of that name; ``UnknownName`` when there are none."""
    if name not in PRESETS:
        raise UnknownName("loss preset", name, PRESETS)
    return PRESETS[name]


def settings_of(profile: str = "default", preset: str = "default") -> Settings:
    """The settings of a named size with named weights; ``msgspec.structs.replace`` changes the rest."""
    return Settings(profile=profile_of(profile), losses=losses_of(preset))
