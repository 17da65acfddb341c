"""The columns of a dataset's tables."""

from __future__ import annotations

from collections.abc import Sequence

from lavsim.dataset.schema import TABLE, FieldSpec

CONTROL = "throttle, steer, brake, hand brake, reverse"
WEATHER = ("cloudiness", "precipitation", "precipitation_deposits", "wind_intensity", "sun_azimuth_angle",
           "sun_altitude_angle", "fog_density", "fog_distance", "fog_falloff", "wetness")  # fmt: skip
ROUTE_POINTS = 20


def table_fields(cameras: Sequence[str] = (), has_scan: bool = False) -> tuple[FieldSpec, ...]:
    """The columns of a table.

    Args:
        cameras: Names of the cameras in whose pictures actors are counted.
        has_scan: Whether there is a LiDAR whose points on actors are counted.
    """
    a, t = ("actors",), ("ticks",)
    scan = (
        _column("lidar_now", "int32", (), "points", "", "how many of the first points of `lidar` are this tick's"),
        _column("actor_lidar_hits", "int32", a, "points", "", "points of `lidar` that lie on the actor"),
    )
    pictures = (
        _column("actor_pixels", "int32", (*a, len(cameras)), "px", "", f"pixels of it in {', '.join(cameras)}"),
    )
    return (
        _column("tick", "int32", (), "0.05 s", "", "tick of the drive; every fifth is a frame, unless the ego stood"),
        _column("position", "float64", (3,), "m", "world", "the ego: box centre in plan, ground level"),
        _column("yaw", "float64", (), "rad", "world", "clockwise from above"),
        _column("pitch", "float64", (), "rad", "world", "nose up"),
        _column("velocity", "float64", (3,), "m/s", "world", ""),
        _column("speed", "float32", (), "m/s", "ego", "along the forward axis, negative in reverse"),
        _column("acceleration", "float32", (3,), "m/s²", "ego", "ahead, right, up, without gravity"),
        _column("rotation_rate", "float32", (3,), "rad/s", "ego", "about the same axes"),
        _column("control", "float32", (5,), "", "", f"{CONTROL}: applied in the tick that led here"),
        _column("wish", "float32", (5,), "", "",
                f"{CONTROL}: what the driver asked for at this tick, before any noise; NaN if not known"),
        _column("brake", "uint8", (), "", "", "1: a full stop for a light, a stop sign or a hazard"),
        _column("brake_cause", "string", (), "", "",
                "none, light, vehicle, walker, prop, stop_sign, junction, goal, unknown"),
        _column("brake_actor", "int32", (), "actor id", "", "whom it stops for; 0 nobody"),
        _column("target_speed", "float32", (), "m/s", "", "what the driver wants to drive; NaN if not known"),
        _column("command", "int8", (), "RoadOption", "",
                "1 left, 2 right, 3 straight, 4 follow, 5, 6 change to the left, right: of the plan node reached "
                "last, by noisy GNSS"),
        _column("goal", "float32", (2,), "m", "ego",
                "the plan node ahead (x ahead, y right), by noisy GNSS and compass"),
        _column("next_goal", "float32", (2,), "m", "ego", "the node after it, or the last again"),
        _column("goal_position", "float64", (2,), "m", "world", "where `goal` truly is"),
        _column("route", "float32", (ROUTE_POINTS, 2), "m", "ego",
                "the next points of the dense route, about a metre apart, the nearest first; the last repeats; free "
                "of noise"),
        _column("route_index", "int32", (), "", "", "of the nearest point on the dense route"),
        _column("route_distance", "float32", (), "m", "", "driven along the route"),
        _column("speed_limit", "float32", (), "m/s", "", "of the route's lane there"),
        _column("in_junction", "bool", (), "", "", "whether that lane lies in a junction"),
        _column("lights", "uint8", ("lights",), "LightState", "",
                "of all traffic lights of the town: 0 red, 1 yellow, 2 green, 3 off, 4 unknown"),
        _column("light", "int16", (), "index", "", "the next light on the route within 100 m; -1 none"),
        _column("light_state", "uint8", (), "LightState", "", "its state; 4 if there is none"),
        _column("light_distance", "float32", (), "m", "",
                "from the ego's front to its stop line along the route; NaN if there is none"),
        _column("stop_sign", "int16", (), "index", "", "the next stop sign on the route within 100 m; -1 none"),
        _column("stop_sign_distance", "float32", (), "m", "", "from the ego's front to its line; NaN if there is none"),
        _column("weather", "float32", (len(WEATHER),), "", "", ", ".join(WEATHER) + ": CARLA's values [%, deg, m]"),
        _column("hazards", "int16", ("hazards",), "index", "", "active hazards by their number in the route"),
        _column("contacts", "int32", ("contacts",), "actor id", "",
                "whom the ego touched since the last frame; 0 is the static world"),
        _column("tick_gnss", "float64", (*t, 3), "deg, deg, m", "world",
                "latitude, longitude, altitude of each tick since the last frame, this one last"),
        _column("tick_imu", "float32", (*t, 7), "m/s², rad/s, rad", "ego",
                "acceleration with gravity (3), rotation rate (3), compass: 0 is north (-y), pi/2 east (+x)"),
        _column("tick_speed", "float32", t, "m/s", "ego", "speedometer"),
        _column("tick_control", "float32", (*t, 5), "", "", f"{CONTROL}: applied in the tick that led there"),
        _column("tick_pose", "float64", (*t, 3), "m, m, rad", "world", "x, y, yaw of the ego, free of noise"),
        _column("actor_id", "int32", a, "actor id", "",
                "all actors within the radius, the ego first; stable in an episode"),
        _column("actor_class", "uint8", a, "ActorClass", "",
                "0 car, 1 van, 2 truck, 3 bus, 4 motorcycle, 5 bicycle, 6 walker, 7 prop"),
        _column("actor_role", "uint8", a, "Role", "", "0 ego, 1 traffic, 2 scenario, 3 parked, 4 prop"),
        _column("actor_blueprint", "string", a, "", "", "CARLA's blueprint"),
        _column("actor_position", "float64", (*a, 3), "m", "world", "box centre in plan, ground level"),
        _column("actor_yaw", "float64", a, "rad", "world", ""),
        _column("actor_pitch", "float32", a, "rad", "world", ""),
        _column("actor_velocity", "float32", (*a, 3), "m/s", "world", ""),
        _column("actor_size", "float32", (*a, 3), "m", "", "full length, width, height"),
        _column("actor_lights", "int32", a, "VehicleLight", "",
                "CARLA's bits: 1 position, 2 low beam, 4 high beam, 8 brake, 16 right, 32 left blinker, 64 reverse, "
                "512, 1024 special"),
        *(scan if has_scan else ()),
        *(pictures if cameras else ()),
    )  # fmt: skip


def _column(name: str, dtype: str, shape: tuple[int | str, ...], unit: str, frame: str, about: str) -> FieldSpec:
    return FieldSpec(name, dtype, shape, unit, frame, "parquet", TABLE, "", about)
