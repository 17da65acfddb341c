"""The command line: each command builds a configuration and calls one function that a test can call too.

The scorer and the agents are loaded inside the commands that need them: `lavsim --help` stays quick, and the simulator
itself depends on neither.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Sequence
from typing import Any

import typer

from lavsim.commands import (  # noqa: F401 - each registers its commands
    ablate,
    bench,
    collect,
    dataset,
    lists,
    routes,
    scenarios,
    score,
    show,
    train,
    view,
)
from lavsim.commands.base import app
from lavsim.errors import LavsimError

# Typer carries its own copy of click from some version on; this is the base of its errors in either.
_USAGE_ERROR: Any = next(base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command; the exit code is 0, or 2 for a user's mistake, told in one line on stderr."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s", stream=sys.stderr)
    try:
        code = app(args=None if arguments is None else list(arguments), prog_name="lavsim", standalone_mode=False)
    except LavsimError as error:
        return _refuse(str(error))
    except _USAGE_ERROR as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()
            return 2
        context = getattr(error, "ctx", None)
        return _refuse(
            f"{error.format_message().rstrip('.')}. See '{context.command_path if context else 'lavsim'} --help'."
        )
    except (typer.Abort, KeyboardInterrupt):
        print("lavsim: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # `lavsim … | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return code if isinstance(code, int) else 0


def _refuse(message: str) -> int:
    print(f"lavsim: {' '.join(message.split())}", file=sys.stderr)
    return 2
