"""OpenDRIVE text of single roads, for tests."""

from __future__ import annotations

from lavsim.map.town_files import build_town
from lavsim.map.town_map import TownMap

WIDTH = 3.5


def lanes(ids: tuple[int, ...] = (1, -1), more: str = "", kind: str = "driving") -> str:
    """A lane section with lanes of one width; `more` stands in each of them."""
    text = ""
    for side, members in (("left", [k for k in ids if k > 0]), ("right", [k for k in ids if k < 0])):
        if members:
            inner = "".join(
                f'<lane id="{k}" type="{kind}"><link><predecessor id="{k}"/><successor id="{k}"/></link>'
                f'<width sOffset="0" a="{WIDTH}"/>{more}</lane>'
                for k in sorted(members, reverse=True)
            )
            text += f"<{side}>{inner}</{side}>"
    return f'<laneSection s="0">{text}</laneSection>'


def road(
    number: int = 1,
    length: float = 50.0,
    shape: str = "<line/>",
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    section: str | None = None,
    attributes: str = "",
    before: str = "",
    behind: str = "",
) -> str:
    """One road with one curve; `before` stands before its lanes, `behind` after them."""
    x, y, heading = start
    return (
        f'<road id="{number}" length="{length!r}" junction="-1" {attributes}>{before if "<link>" in before else ""}'
        f'<planView><geometry s="0" x="{x!r}" y="{y!r}" hdg="{heading!r}" length="{length!r}">{shape}</geometry>'
        f"</planView>{before if '<link>' not in before else ''}"
        f"<lanes>{section or lanes()}</lanes>{behind}</road>\n"
    )


def town(*parts: str) -> TownMap:
    """A town of these parts."""
    return build_town("t", ("<OpenDRIVE>\n" + "".join(parts) + "</OpenDRIVE>").encode(), "t.xodr")
