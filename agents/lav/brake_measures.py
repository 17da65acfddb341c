"""How well the brake network tells: full stops, and of what tells causes lights, stop signs and others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.lav.data.signals import GREEN, LIGHT_REACH, RED, YELLOW, Signals
from agents.lav.models.brake import Causes
from lavsim.dataset.reader import Dataset
from lavsim.types import LightState

RED_FROM, RED_TO = 5.0, 30.0  # [m] to the stop line: where a red light has to be told
_STANDING = 12.0  # [m] to the line: where egos wait
_SURE = 0.5  # told causes are more likely than this
_SIGN_TO = 15.0  # [m] where a stop sign has to be told
_STANDS = 0.1  # [m/s]


class Facts(NamedTuple):
    """What was so in frames; all (N,).

    Attributes:
        brake: Whether the expert made a full stop.
        cause: Why.
        red: Whether it did so before a red light 5 to 30 m ahead.
        stands: Whether the ego does.
    """

    brake: NDArray[np.bool_]
    cause: NDArray[np.str_]
    red: NDArray[np.bool_]
    stands: NDArray[np.bool_]


def facts_of(data: Dataset, frames: NDArray[np.int64]) -> Facts:
    """The facts of frames (N, 2)."""
    names = ("brake", "brake_cause", "light_state", "light_distance", "speed")
    rows = [data.table(episode).row(frame, names) for episode, frame in frames.tolist()]
    brake = np.array([bool(row["brake"]) for row in rows])
    state, distance = (np.array([float(row[name]) for row in rows]) for name in names[2:4])
    red = brake & (state == LightState.RED) & (distance >= RED_FROM) & (distance <= RED_TO)
    stands = np.array([abs(float(row["speed"])) < _STANDS for row in rows])
    return Facts(brake, np.array([str(row["brake_cause"]) for row in rows]), red, stands)


def measures_of(scores: NDArray[np.float64], facts: Facts, threshold: float) -> dict[str, float]:
    """Average precision, and at a threshold: recall by cause, of red lights, precision and false alarms."""
    told, brake = scores > threshold, facts.brake
    groups = {f"recall_{cause}": brake & (facts.cause == cause) for cause in np.unique(facts.cause[brake]).tolist()}
    groups |= {"recall_red": facts.red, "recall": brake, "false_alarms": ~brake}
    found = {name: float(told[group].mean()) for name, group in groups.items() if group.any()}
    found["precision"] = float(brake[told].mean()) if told.any() else 0.0
    counts = {"frames": float(len(scores)), "frames_braking": float(brake.sum()), "frames_red": float(facts.red.sum())}
    return {"average_precision": average_precision(scores, brake), **found, **counts}


def average_precision(scores: NDArray[np.float64], truth: NDArray[np.bool_]) -> float:
    """Mean precision at the ranks of the true ones; equal scores are one rank."""
    order = np.argsort(-scores, kind="stable")
    hits, ranked = np.cumsum(truth[order]), scores[order]
    last = np.flatnonzero(np.append(np.diff(ranked) != 0.0, True))
    recall = hits[last] / max(int(hits[-1]), 1)
    return float(np.sum(np.diff(recall, prepend=0.0) * hits[last] / (last + 1)))


def signal_measures(causes: Causes, truth: Signals, kind: str, facts: Facts | None = None) -> dict[str, float]:
    """Of lights, stop signs and others in frames, where the likelier half is told; each name begins with `kind`.

    Args:
        causes: What the network says.
        truth: What is so.
        kind: Of the frames.
        facts: Of recorded ones: parts those that stand from those that drive.
    """
    light = causes.light.softmax(dim=1).double().numpy()
    halts, sign = light[:, RED] + light[:, YELLOW] > _SURE, (causes.sign.sigmoid() > _SURE).numpy()
    others = (causes.others.sigmoid() > _SURE).numpy()
    ahead = np.nan_to_num(truth.distance, nan=np.inf)
    in_reach = (ahead >= RED_FROM) & (ahead <= RED_TO)
    free = (truth.light == 0) | (truth.light == GREEN)
    near = ahead <= _STANDING
    told: dict[str, tuple[NDArray[np.bool_], NDArray[np.bool_]]] = {
        "red_told": ((truth.light == RED) & in_reach, halts),
        "red_near_told": ((truth.light == RED) & near, halts),
        "yellow_told": ((truth.light == YELLOW) & in_reach, halts),
        "green_near_held": ((truth.light == GREEN) & near, halts),
        "green_held": ((truth.light == GREEN) & ~near, halts),
        "no_light_held": (truth.light == 0, halts),
        "sign_told": ((truth.sign == 1) & (ahead <= _SIGN_TO), sign),
        "sign_false": (truth.sign == 0, sign),
        "others_told": (truth.others == 1, others),
        "others_false": (truth.others == 0, others),
    }
    if facts is not None:
        drives = ~facts.stands
        told |= {
            "red_told_driving": ((truth.light == RED) & in_reach & drives, halts),
            "light_cause_told_driving": ((facts.cause == "light") & drives, halts),
            "light_false_driving": (free & drives, halts),
            "light_false_standing": (free & facts.stands, halts),
            "green_standing_held": ((truth.light == GREEN) & near & facts.stands & ~facts.brake, halts),
            "others_false_driving": ((truth.others == 0) & drives, others),
            "walker_told": (facts.cause == "walker", others),
        }
    found = {f"{kind}_{name}": float(hit[group].mean()) for name, (group, hit) in told.items() if group.any()}
    found |= {f"{kind}_{name}_frames": float(group.sum()) for name, (group, _) in told.items() if group.any()}
    known = ahead <= LIGHT_REACH
    if known.any():
        off = np.abs(causes.distance.double().numpy() - ahead)
        found[f"{kind}_distance_error"] = float(np.median(off[known]))
        if (known & near).any():
            found[f"{kind}_distance_error_near"] = float(np.median(off[known & near]))
    return found
