"""What cloning learns from: frames, what the ego was told there, and where the expert drove on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.lav.config import LavConfig
from agents.lav.frames import command_of, planner_from_vehicle, planner_from_world
from agents.lav.labels import is_pushed
from lavsim.dataset.reader import Dataset
from lavsim.dataset.windows import Windows
from lavsim.errors import ConfigError

STANDS = 0.1  # [m/s]
GOES = 1.0  # [m] farther at the end of a window: it drives on
BENDS = 1.5  # [m] aside there
_WAITING_STRIDE = 2  # of frames in which it waits every other
_STARTS_AGAIN, _BENDS_AGAIN = 3, 3  # times


@dataclass(frozen=True)
class CloningSamples:
    """Frames with enough of a future, in the planner's frame.

    Attributes:
        places: (N, 2) episode and frame.
        futures: (N, T, 2) float32, the ego's own [m].
        speeds: (N,) float32 [m/s].
        commands: (N,) int64, 0 to 5.
        goals: (N, 2, 2) float32 [m].
        brakes: (N,) whether the expert made a full stop.
        pushed: (N,) whether noise on its control makes a future that no driver chose.
    """

    places: NDArray[np.int64]
    futures: NDArray[np.float32]
    speeds: NDArray[np.float32]
    commands: NDArray[np.int64]
    goals: NDArray[np.float32]
    brakes: NDArray[np.bool_]
    pushed: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.places)

    @property
    def stands(self) -> NDArray[np.bool_]:
        """(N,) whether the ego does."""
        return np.abs(self.speeds) < STANDS

    @property
    def goes(self) -> NDArray[np.bool_]:
        """(N,) whether it is somewhere else at the end."""
        return np.asarray(np.hypot(*self.futures[:, -1].T) > GOES)


def read_samples(data: Dataset, config: LavConfig) -> CloningSamples:
    """All frames of a dataset that have enough behind them.

    Raises:
        ConfigError: there is none.
    """
    steps = config.motion.waypoints
    windows = Windows(list(data.episodes.values()), steps)
    if not len(windows):
        raise ConfigError(f"{data.root.name} holds no {steps + 1} frames in a row.")
    places = np.array([windows[k] for k in range(len(windows))])
    parts: dict[str, list[NDArray[np.generic]]] = {name: [] for name in CloningSamples.__annotations__}
    for episode in dict.fromkeys(places[:, 0].tolist()):
        table, frames = data.table(episode), places[places[:, 0] == episode, 1]
        position, yaw = table["position"][:, :2], table["yaw"]
        futures = [planner_from_world(position[k + 1 : k + steps + 1], position[k], float(yaw[k])) for k in frames]
        goals = np.stack([table["goal"][frames], table["next_goal"][frames]], axis=1)
        parts["places"].append(places[places[:, 0] == episode])
        parts["futures"].append(np.array(futures, np.float32))
        parts["speeds"].append(table["speed"][frames].astype(np.float32))
        parts["commands"].append(np.array([command_of(int(option)) for option in table["command"][frames]], np.int64))
        parts["goals"].append(planner_from_vehicle(goals).astype(np.float32))
        parts["brakes"].append(table["brake"][frames].astype(bool))
        parts["pushed"].append(np.array([is_pushed(table, int(k), steps) for k in frames], bool))
    return CloningSamples(**{name: np.concatenate(values) for name, values in parts.items()})


def worth_learning(samples: CloningSamples) -> NDArray[np.int64]:
    """Numbers of the frames to learn from: long waits seldom, starts and bends several times, no pushes.

    A quarter of a town's drive is waiting. Learnt as often as it comes, it is all that is done after the first stop.
    """
    times = np.ones(len(samples), np.int64)
    waits, starts = samples.stands & ~samples.goes, (samples.speeds < GOES) & samples.goes
    times[waits] = samples.places[waits, 1] % _WAITING_STRIDE == 0
    times[np.abs(samples.futures[:, -1, 0]) > BENDS] = _BENDS_AGAIN
    times[starts] = _STARTS_AGAIN
    times[samples.pushed] = 0
    return np.repeat(np.arange(len(samples)), times)
