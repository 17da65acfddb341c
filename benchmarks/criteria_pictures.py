"""Pictures of criteria: what each spares and where it fires, side by side, into `docs/pictures/criteria`.

python -m benchmarks.criteria_pictures [criterion …] [--out docs/pictures/criteria]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.criteria_places import Panel, Stage, judge
from benchmarks.criteria_stages import STAGES
from lavsim.render.birdseye import draw_snapshot
from lavsim.render.canvas import write_text
from lavsim.render.palette import Bgr
from lavsim.render.scene import get_scene

SIZE, BAND, GAP, QUALITY = (268, 220), 24, 6, 72  # [px]
WHITE: Bgr = (255, 255, 255)
SPARES, FIRES = (70, 120, 40), (40, 40, 190)
COLOURS: dict[str, Bgr] = {"red": (40, 40, 230), "yellow": (40, 230, 255), "violet": (190, 40, 150)}
WIDTH = 0.35  # [m] of a mark


def draw_panel(name: str, stage: Stage, panel: Panel) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 blue, green, red: the moment below what is said of it.

    Raises:
        AssertionError: If the criterion does not say what the panel says.
    """
    count, snapshot = judge(name, stage.rules, panel)
    assert count == panel.earlier + panel.fires, f"{name}, {panel.says!r}: fired {count} times"
    street = panel.street
    canvas = draw_snapshot(get_scene(street.town), snapshot, SIZE, stage.metres, street.route.points, stage.ahead)
    for colour, points, closes in panel.marks(snapshot):
        canvas.outline(points, COLOURS[colour], max(2, round(WIDTH * canvas.scale)), closed=closes)
    band = np.empty((BAND, SIZE[0], 3), np.uint8)
    band[:] = FIRES if panel.fires else SPARES
    write_text(band, panel.says, (6, 16), 0.43, WHITE)
    return np.concatenate([band, canvas.image])


def draw(name: str) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 blue, green, red: a criterion's two panels."""
    stage = STAGES[name]()
    spared, fired = (draw_panel(name, stage, panel) for panel in stage.panels)
    return np.concatenate([spared, np.full((len(spared), GAP, 3), 255, np.uint8), fired], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("criteria", nargs="*", default=list(STAGES))
    parser.add_argument("--out", type=Path, default=Path("docs/pictures/criteria"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.criteria:
        path = given.out / f"{name}.jpg"
        cv2.imwrite(str(path), draw(name), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        print(f"{path}  {path.stat().st_size / 1000:.1f} kB")


if __name__ == "__main__":
    main()
