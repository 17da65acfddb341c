"""`lavsim view`: mistakes in one line, and which route is driven."""

from __future__ import annotations

import pytest

from lavsim.cli import main
from lavsim.commands.view import _entry


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--agent", "a:B", "--keyboard"], "one of them drives"),
        (["nofile"], "nofile"),
        (["quick", "--route-id", "99"], "99"),
        (["--town", "nowhere"], "nowhere"),
        (["--port", "70000"], "65535"),
        (["--agent", "no.such:Agent"], "no.such"),
    ],
)
def test_mistakes_are_one_line(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", "--no-browser", *arguments]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1


def test_first_route_of_a_file_or_the_one_named_is_driven() -> None:
    first, second = _entry("quick", None, None, 0, ()), _entry("devtest", "1", None, 0, ())
    assert first.file.startswith("quick")
    assert second.id == "1"
