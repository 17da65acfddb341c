"""The paper's ablations as named sets of overrides, each tied to its row (reference `lav.md` 5.3 and 9)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lavsim.errors import UnknownName


@dataclass(frozen=True)
class Variant:
    """A row of one of the paper's tables.

    Attributes:
        row: Table and row.
        sets: What differs from the preset, as `--set` takes it.
        score: The paper's driving score, mean of three runs on its two test towns.
        completion: Its route completion [%].
    """

    row: str
    sets: Sequence[str]
    score: float
    completion: float


_COMPONENTS, _RADIUS, _SCHEME, _REFINEMENT = "components", "radius", "perception", "refinement"

VARIANTS: Mapping[str, Variant] = {
    "full": Variant(f"{_COMPONENTS}: LAV", (), 45.20, 91.55),
    "ego-only": Variant(f"{_COMPONENTS}: ego only", ("lav.training.others=false",), 38.56, 84.76),
    "no-distillation": Variant(f"{_COMPONENTS}: no distillation", ("lav.training.distillation=false",), 28.23, 81.05),
    "lidar-only": Variant(f"{_COMPONENTS}: LiDAR-only backbone", ("lav.painted=false",), 26.37, 74.96),
    "radius-5": Variant(f"{_RADIUS}: 5 m", ("lav.motion.radius=5.0",), 46.06, 88.77),
    "radius-15": Variant(f"{_RADIUS}: 15 m", ("lav.motion.radius=15.0",), 45.20, 91.55),
    "radius-25": Variant(f"{_RADIUS}: 25 m", ("lav.motion.radius=25.0",), 37.42, 89.56),
    "perception-none": Variant(f"{_SCHEME}: none", ('lav.training.perception="none"',), 8.47, 9.34),
    "perception-joint": Variant(f"{_SCHEME}: joint", ('lav.training.perception="joint"',), 28.36, 79.58),
    "perception-staged": Variant(f"{_SCHEME}: staged", ('lav.training.perception="staged"',), 45.20, 91.55),
    "refinements-0": Variant(f"{_REFINEMENT}: K = 0", ("lav.motion.refinements=0",), 12.69, 35.85),
    "refinements-1": Variant(f"{_REFINEMENT}: K = 1", ("lav.motion.refinements=1",), 21.30, 85.90),
    "refinements-5": Variant(f"{_REFINEMENT}: K = 5", ("lav.motion.refinements=5",), 45.20, 91.55),
}


def find_variant(name: str) -> Variant:
    """The variant called `name`.

    Raises:
        UnknownName: there is none.
    """
    try:
        return VARIANTS[name]
    except KeyError:
        raise UnknownName("variant", name, VARIANTS) from None
