"""Mutations of map files, and everything a town answers."""

from __future__ import annotations

import random
import re
from pathlib import Path

import numpy as np

from lavsim.errors import MapError
from lavsim.map.check import check_town
from lavsim.map.town_files import build_town
from lavsim.map.town_map import TownMap
from tests.map.shared import SHARED

LARGEST = 250_000  # bytes; larger files are as well covered by small ones
NUMBER = re.compile(rb'"-?\d[^"]*"')
VALUES = (
    b'"nan"', b'"inf"', b'"1e308"', b'"-1e308"', b'"1e-300"', b'"1e9"', b'"1e5"', b'"-1e5"', b'"999999"', b'"1e3"',
    b'"0"', b'"-0"', b'"1"', b'"-1"', b'"2"', b'"-3"', b'""', b'"x"', b'"1_0"', '"٣"'.encode(), b'"0x1"',
)  # fmt: skip
WORDS = (
    b"line", b"arc", b"spiral", b"poly3", b"paramPoly3", b"driving", b"sidewalk", b"border", b"width", b"start",
    b"end", b"road", b"junction", b"length", b"curvature", b"left", b"right", b"successor", b"predecessor",
)  # fmt: skip


def sources() -> list[Path]:
    """Bundled towns and, where they are at hand, the sample files beside the repository."""
    bundled = sorted((Path(__file__).parents[2] / "lavsim" / "towns").glob("*.xodr"))
    found = [*bundled, *sorted((SHARED / "maps").glob("*/*.xodr"))]
    small = [path for path in found if path.stat().st_size <= LARGEST]
    return small or found[:1]


def mutate(data: bytes, rng: random.Random) -> bytes:
    """`data` with one to three mistakes: numbers, lines, words or bytes changed, doubled or lost; or an end cut off."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        kind = rng.random()
        if kind < 0.55:
            hits = list(NUMBER.finditer(data))
            if hits:
                hit = rng.choice(hits)
                value = rng.choice(VALUES) if rng.random() < 0.7 else rng.choice(hits).group()
                data = data[: hit.start()] + value + data[hit.end() :]
        elif kind < 0.8:
            lines = data.split(b"\n")
            first, count = rng.randrange(len(lines)), rng.choice((1, 1, 2, 5, 40))
            if kind < 0.7:
                del lines[first : first + count]
            else:
                lines[rng.randrange(len(lines)) : 0] = lines[first : first + count]
            data = b"\n".join(lines)
        elif kind < 0.85:
            data = data[: rng.randrange(len(data) + 1)]
        elif kind < 0.93:
            at = rng.randrange(max(len(data), 1))
            data = data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]
        else:
            data = data.replace(rng.choice(WORDS), rng.choice(WORDS), rng.choice((1, -1)))
    return data


def ask(town: TownMap) -> None:
    """Asks a town everything once."""
    point = town.lanes.points[0, :3]
    town.nearest(np.stack([point, np.zeros(3), np.array([1e9, -1e9, 0.0])]))
    town.project([point])
    place = town.waypoint_at(0, float(town.lanes.length[0]) / 2.0)
    for where in (place, place.left(), place.right()):
        if where is not None:
            assert len(where.xyz) == 3
            where.next(10.0)
            where.previous(10.0)
            where.landmarks(60.0)
    assert town.marks is not None
    town.speed_limit_at([point])
    check_town(town)


def drive(count: int, seed: int, question_every: int = 3) -> tuple[int, int]:
    """Builds `count` mutated files; how many were towns, and how many were refused.

    Raises:
        AssertionError: something else than `MapError` came, or a message of several lines.
    """
    rng = random.Random(seed)
    files = [path.read_bytes() for path in sources()]
    towns = refused = 0
    said: list[str] = []
    for number in range(count):
        data = mutate(rng.choice(files), rng)
        try:
            town = build_town("mutant", data, "mutant.xodr")
            towns += 1
            if number % question_every == 0:
                ask(town)
        except MapError as error:
            refused += 1
            said.append(str(error))
        except Exception as error:
            raise AssertionError(f"seed {seed}, file {number}: {type(error).__name__}: {error}") from error
    assert all("\n" not in text and len(text) < 600 for text in said)
    return towns, refused
