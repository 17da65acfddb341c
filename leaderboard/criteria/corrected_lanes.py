"""Off the road or against the traffic, judged anew in every tick: `--rules corrected`."""

from __future__ import annotations

from leaderboard.criteria.base import CRITERIA
from leaderboard.criteria.outside_route_lanes import OutsideRouteLanes


@CRITERIA.register("corrected_lanes")
class CorrectedLanes(OutsideRouteLanes):
    """As the original, but a lane is wrong when it leads against the ego's heading: no flag, no memory.

    The originals toggle a flag when the lane under the ego changes. 1.0 loses it at the next piece of road and raises
    it on the way back to the right lane; none of them sees a drive that begins in the wrong lane.
    """

    name = "corrected_lanes"
    applies = ("corrected",)
    instead_of = "outside_route_lanes"

    against = 120.0  # [deg] between ego and lane, the originals' limit where a junction is left

    def _follow_lane(self, lane: int, lane_yaw: float, ego_yaw: float) -> None:
        angle = (lane_yaw - ego_yaw) % 360.0
        in_junction = bool(self._town.lanes.junction[lane] >= 0)
        self._wrong_lane = not in_junction and self.against <= angle <= 360.0 - self.against
