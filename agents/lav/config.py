"""Every size of LAV in one tree, and its presets.

Sources: reference `lav.md` sections 2, 4 and 6.5 for `paper`; `tiny` and `small` are sizes for CPUs (the design's
presets). Frames: the vehicle's (x forward, y right) for ranges, the planner's (`agents.lav.frames`) for plans.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import Field, model_validator

from lavsim.config import Config
from lavsim.errors import UnknownName

COMMANDS = 6  # left, right, straight, follow, change left, change right
TIME_STEP = 0.25  # [s] between waypoints and between kept frames


class GridConfig(Config):
    """The bird's-eye grid that perception and labels share."""

    behind: float = Field(default=10.0, gt=0.0, description="Reach behind the ego's origin [m].")
    ahead: float = Field(default=70.0, gt=0.0, description="Reach ahead [m].")
    aside: float = Field(default=40.0, gt=0.0, description="Reach to each side [m].")
    cell: float = Field(default=0.25, gt=0.0, description="Side of a cell [m].")

    @property
    def rows(self) -> int:
        """Cells from ahead to behind."""
        return round((self.ahead + self.behind) / self.cell)

    @property
    def cols(self) -> int:
        """Cells from left to right."""
        return round(2.0 * self.aside / self.cell)

    @model_validator(mode="after")
    def _even(self) -> GridConfig:
        if self.rows % 8 or self.cols % 8:
            raise ValueError(f"a grid needs rows and columns divisible by 8, these make {self.rows} x {self.cols}")
        return self


class CropConfig(Config):
    """The window around a vehicle that its motion is read from, heading up."""

    side: float = Field(default=48.0, gt=0.0, description="Side of the square [m].")
    behind: float = Field(default=6.0, ge=0.0, description="Of it behind the vehicle [m].")
    cell: float = Field(default=0.5, gt=0.0, description="Cell of the student's crop, from features [m].")
    teacher_cell: float = Field(default=0.25, gt=0.0, description="Cell of the teacher's crop, from labels [m].")


class CameraConfig(Config):
    """Images as the networks take them; the sensors' are halved where these are half their size."""

    height: int = Field(default=288, gt=0, description="Of each of the three wide images [px].")
    width: int = Field(default=256, gt=0, description="[px]")
    telephoto_height: int = Field(default=192, gt=0, description="Of the telephoto without its lowest third [px].")
    telephoto_width: int = Field(default=480, gt=0, description="[px]")


class SegmentationConfig(Config):
    """The network that paints points."""

    network: Literal["erfnet", "unet", "light"] = "erfnet"
    widths: tuple[int, ...] = Field(default=(16, 64, 128), description="Channels at strides 2, 4, 8 (and 16: light).")
    blocks: tuple[int, int] = Field(default=(5, 2), description="ERFNet's residual blocks at stride 4, rounds at 8.")


class ResNetConfig(Config):
    """A residual network of basic blocks."""

    depth: Literal[10, 18] = 18
    width: int = Field(default=64, gt=0, description="Channels of the first stage; doubled in each further one.")

    @property
    def features(self) -> int:
        """Channels at the end."""
        return 8 * self.width


class BrakeConfig(ResNetConfig):
    """The network that brakes."""

    causes: bool = Field(
        default=False, description="Whether it tells lights, stop signs and others apart, not only whether to stop."
    )
    sharp: tuple[int, int] | None = Field(
        default=None, description="Rows and columns of the telephoto's middle, unshrunk, in place of all of it [px]."
    )


class PillarConfig(Config):
    """Points to pillars."""

    points: int = Field(default=40_000, gt=0, description="At most so many a scan; the rest is left out by hash.")
    widths: tuple[int, ...] = Field(default=(32, 32), description="Of the linear layers.")


class BackboneConfig(Config):
    """The bird's-eye convolutions and heads."""

    width: int = Field(default=32, gt=0, description="C: channels at stride 2.")
    head_width: int = Field(default=64, gt=0)
    neck: int | None = Field(default=None, description="Channels after a 1x1 convolution before RoIs; None keeps 6C.")
    shared_head: bool = Field(default=False, description="One first convolution for all heads.")
    detection_radius: float = Field(default=15.0, gt=0.0, description="Labels of vehicles within [m].")
    walker_radius: float = Field(default=10.0, gt=0.0, description="Labels of pedestrians within [m].")
    ring: float = Field(default=10.0, ge=0.0, description="Beyond the radius, where nothing counts as background [m].")
    least_hits: int = Field(default=0, ge=0, description="Actors with fewer points are neither found nor denied.")


class MotionConfig(Config):
    """Plans and forecasts."""

    embedding: ResNetConfig = ResNetConfig()
    coarse_hidden: int = Field(default=64, gt=0)
    refine_hidden: int | None = Field(default=None, description="Of the refiner; None takes the embedding's size.")
    waypoints: int = Field(default=10, gt=0, description="T, a quarter of a second apart.")
    refinements: int = Field(default=5, ge=0, description="K.")
    radius: float = Field(default=15.0, gt=0.0, description="Vehicles farther from the ego are not learnt from [m].")
    pooling: Literal["mean", "grid"] = Field(
        default="mean", description="How a window becomes a vector: the mean of its last cells, or a layer over them."
    )
    speeds: bool = Field(default=False, description="Whether a vehicle's own speed is an input beside its window.")
    goals: int = Field(default=1, ge=1, le=2, description="Goal points that refine a plan: the next, or the next two.")
    goals_embedded: bool = Field(default=False, description="Whether the ego's are an input beside its window too.")


class TemporalConfig(Config):
    """Scans that are stacked."""

    scans: int = Field(default=1, ge=1, description="Scans a quarter of a second apart; 3 in the leaderboard entry.")


class PidConfig(Config):
    """Gains; the integral is the mean of the last errors, and time does not enter."""

    proportional: float = 0.0
    integral: float = 0.0
    derivative: float = 0.0
    window: int = Field(default=40, gt=0, description="Errors that the integral averages [ticks].")


class DriveConfig(Config):
    """From a plan to a control, and what overrules it (reference `lav.md` 6.3 to 6.5; one value a command).

    Gains and aims are those of the leaderboard entry: the paper's (1.0, and always the fifth waypoint) cut bends here
    by more than a metre. Speeds are ours: the expert drives faster than CARLA's cautious one.
    """

    steering: PidConfig = PidConfig(proportional=0.8, integral=0.5, derivative=0.2)
    speed: PidConfig = PidConfig(proportional=5.0, integral=0.5, derivative=1.0)
    pursuit: bool = Field(default=True, description="Steers along the arc through the aim, not by the steering gains.")
    aim: tuple[int, ...] = Field(default=(4, 4, 4, 3, 6, 6), description="Waypoint that is steered at, from 0.")
    speed_ratio: tuple[float, ...] = Field(default=(1.0,) * COMMANDS, description="Part of the planned speed.")
    stop_below: float = Field(default=0.8, ge=0.0, description="Planned speeds below this are a stop [m/s].")
    error_clip: float = Field(default=0.25, gt=0.0, description="Of the speed's error [m/s].")
    most_throttle: float = Field(default=0.8, gt=0.0, le=1.0)
    speed_cap: float = Field(default=35.0 / 3.6, gt=0.0, description="No throttle above [m/s].")
    over_speed: float = Field(default=1.5, gt=0.0, description="Brakes when faster than planned by this [m/s].")
    brake_score: float = Field(default=0.3, ge=0.0, le=1.0, description="Scores of the brake network above stop it.")
    collision_margin: float = Field(default=0.15, ge=0.0, description="Around the ego's box against forecasts [m].")
    front_margin: float = Field(default=0.6, ge=0.0, description="Before its front, beside that [m].")
    likely: float = Field(default=0.2, ge=0.0, le=1.0, description="Commands of others below are left out.")
    refined_lane_change: bool = Field(default=False, description="Whether lane changes take the refined plan too.")
    stuck: float = Field(default=10.0, gt=0.0, description="Creeps after standing so long [s]; 30 in the original.")
    creep: float = Field(default=1.5, ge=0.0, description="For so long [s]; 1 in the original.")
    look_every: int = Field(
        default=2, ge=1, description="Ticks from one look at road and others to the next; a turn of the LiDAR is two."
    )
    brake_every: int = Field(default=2, ge=1, description="Ticks from one look of the brake network to the next.")
    standing_score: float = Field(default=0.65, ge=0.0, le=1.0, description="The same for who has stood for `hold`.")
    hold: float = Field(default=2.0, ge=0.0, description="So long any score holds who stands [s].")
    stuck_held: float = Field(default=60.0, gt=0.0, description="So long where the brake network holds it [s].")
    filtered: bool = Field(default=True, description="Goals as seen from the filter's place, not the newest fix.")
    detection_score: float = Field(default=0.3, ge=0.0, le=1.0, description="Vehicles found with less are left out.")
    walker_score: float = Field(default=0.35, ge=0.0, le=1.0, description="Walkers; 1: the brake network only.")
    doubtful_score: float = Field(
        default=0.12, ge=0.0, le=1.0, description="Found with more, what moves like somebody is taken for one, too."
    )
    doubtful_speed: float = Field(default=1.5, ge=0.0, description="So fast, then [m/s].")
    forecasts: int = Field(default=8, ge=0, description="Vehicles whose motions are foreseen: the nearest ahead.")
    slack: float = Field(default=0.3, ge=0.0, description="Taken off found boxes that stand, up to half [m].")
    standing: float = Field(default=0.8, ge=0.0, description="Tracked slower than this, a vehicle stands [m/s].")
    comfort: float = Field(default=3.0, gt=0.0, description="Brakes so for lines and others ahead [m/s²].")
    room: float = Field(default=1.5, ge=0.0, description="Kept before others that are in the way [m].")
    leader_brakes: float = Field(
        default=3.0, ge=0.0, description="What who goes the ego's way may brake with [m/s²]; 0: learned forecasts only."
    )
    bumper: float = Field(
        default=45.0, ge=0.0, description="Points right before the bumper hold who stands so long [s]; 0: they don't."
    )
    caution: float = Field(default=0.4, ge=0.0, description="So long it goes on braking for walkers once it began [s].")
    patience: float = Field(default=4.0, ge=0.0, description="Standing longer, it passes others more narrowly [s].")
    yield_time: float = Field(default=8.0, gt=0.0, description="So long until it does so fully [s].")
    most_yield: float = Field(default=0.4, ge=0.0, description="Margins aside are then smaller by [m].")
    least_seen: int = Field(default=2, ge=1, description="Looks in which somebody is found before he counts.")
    light_score: float = Field(default=0.4, ge=0.0, le=1.0, description="Red or yellow is told above.")
    light_gap: float = Field(
        default=7.0, description="From its front to the end of a light's lane [m]; it is painted 5 m before."
    )
    sign_score: float = Field(default=0.2, ge=0.0, le=1.0, description="A stop sign is told above.")
    sign_gap: float = Field(default=2.0, description="The same before a stop sign [m].")
    others_score: float = Field(
        default=0.5, ge=0.0, le=1.0, description="Brakes while it drives where others are told above; 1: never."
    )


class TrainingConfig(Config):
    """What the stages learn from and in which order: the paper's ablations (reference `lav.md` 5.3)."""

    others: bool = Field(default=True, description="Whether motion is learnt from all vehicles, not the ego's alone.")
    distillation: bool = Field(default=True, description="Whether the student mimics the teacher, not the log.")
    perception: Literal["none", "joint", "staged"] = Field(
        default="staged", description="Perception's losses: never, together with motion, or before it and together."
    )
    painting: Literal["network", "truth"] = Field(default="network", description="What paints the points.")
    approaches: int = Field(
        default=0, ge=0, description="Frames before lights of any state and stop signs, rendered for the brake network."
    )
    balanced: bool = Field(default=False, description="Whether walkers and marks, which are few, weigh more.")


class LavConfig(Config):
    """All sizes of one LAV."""

    name: str = "paper"
    grid: GridConfig = GridConfig()
    crop: CropConfig = CropConfig()
    cameras: CameraConfig = CameraConfig()
    segmentation: SegmentationConfig = SegmentationConfig()
    brake: BrakeConfig = BrakeConfig()
    pillars: PillarConfig = PillarConfig()
    painted: bool = Field(default=True, description="Whether points carry what the cameras saw there.")
    backbone: BackboneConfig = BackboneConfig()
    motion: MotionConfig = MotionConfig()
    temporal: TemporalConfig = TemporalConfig()
    training: TrainingConfig = TrainingConfig()
    drive: DriveConfig = DriveConfig()

    @property
    def point_features(self) -> int:
        """x, y, z, intensity, four painted scores, and one time tag a scan where there are several."""
        scans = self.temporal.scans
        return 4 + 4 * self.painted + (scans if scans > 1 else 0)


_SMALL_CAMERAS = CameraConfig(height=144, width=128, telephoto_height=96, telephoto_width=240)
_SHARP = (176, 352)  # lamps far away are two pixels wide; what is nearer shows in the wide images
_APPROACHES = 20_000
_TINY_RESNET = ResNetConfig(depth=10, width=16)
# The paper's radius of 15 m is the motions'; cars are told from farther, so that forecasts of them have a beginning.
_FAR_SIGHTED = BackboneConfig(neck=32, shared_head=True, detection_radius=35.0, walker_radius=25.0, least_hits=3)

PRESETS: Mapping[str, LavConfig] = {
    "paper": LavConfig(),
    "small": LavConfig(
        name="small",
        grid=GridConfig(cell=0.5),
        crop=CropConfig(side=48.0, behind=6.0, cell=1.0, teacher_cell=0.5),
        cameras=_SMALL_CAMERAS,
        segmentation=SegmentationConfig(network="erfnet", widths=(8, 32, 64), blocks=(3, 1)),
        brake=BrakeConfig(depth=10, width=32, causes=True, sharp=_SHARP),
        pillars=PillarConfig(points=20_000),
        backbone=_FAR_SIGHTED,
        training=TrainingConfig(approaches=_APPROACHES, balanced=True),
        motion=MotionConfig(embedding=ResNetConfig(depth=10, width=32), refine_hidden=256),
    ),
    "tiny": LavConfig(
        name="tiny",
        grid=GridConfig(behind=8.0, ahead=56.0, aside=32.0, cell=0.5),
        crop=CropConfig(side=40.0, behind=5.0, cell=1.0, teacher_cell=0.5),
        cameras=_SMALL_CAMERAS,
        segmentation=SegmentationConfig(network="light", widths=(16, 32, 64, 96), blocks=(0, 0)),
        brake=BrakeConfig(depth=10, width=16, causes=True, sharp=_SHARP),
        pillars=PillarConfig(points=12_000),
        backbone=_FAR_SIGHTED,
        training=TrainingConfig(approaches=_APPROACHES, balanced=True),
        motion=MotionConfig(embedding=_TINY_RESNET, pooling="grid", speeds=True, goals=2, goals_embedded=True),
    ),
    "micro": LavConfig(
        name="micro",
        grid=GridConfig(behind=8.0, ahead=24.0, aside=16.0, cell=1.0),
        crop=CropConfig(side=24.0, behind=4.0, cell=2.0, teacher_cell=1.0),
        cameras=CameraConfig(height=48, width=48, telephoto_height=32, telephoto_width=80),
        segmentation=SegmentationConfig(network="light", widths=(4, 8, 8, 8), blocks=(0, 0)),
        brake=BrakeConfig(depth=10, width=4),
        pillars=PillarConfig(points=1_000, widths=(8, 8)),
        backbone=BackboneConfig(width=8, head_width=8, neck=8, shared_head=True),
        motion=MotionConfig(embedding=ResNetConfig(depth=10, width=4), coarse_hidden=8, waypoints=4, refinements=2),
    ),
}


def find_preset(name: str) -> LavConfig:
    """The preset called `name`.

    Raises:
        UnknownName: there is none.
    """
    try:
        return PRESETS[name]
    except KeyError:
        raise UnknownName("preset", name, PRESETS) from None
