"""The console script `osl`: parses the command line and turns what goes wrong into one line and an exit code.

0: done; 2: bad input, said in one line on stderr; 130: stopped by Ctrl-C. Anything else that is raised is a bug and
keeps its traceback. Heavy imports wait for the command that needs them.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
from collections.abc import Sequence
from typing import Annotated

import tyro

from osl_env.errors import InputError
from training.commands.bench import Bench
from training.commands.listing import Listing
from training.commands.plume import Plume
from training.commands.reproduce import Reproduce
from training.commands.run import Run
from training.commands.train import Train

DESCRIPTION = """Teams of UAVs that search gas sources in 3D: run policies, compare them, train them, reproduce papers.

`osl --version` prints the version."""

Command = (
    Annotated[Listing, tyro.conf.subcommand("list")]
    | Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[Reproduce, tyro.conf.subcommand("reproduce")]
    | Annotated[Plume, tyro.conf.subcommand("plume")]
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line `arguments` (default: the process's own); the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if words == ["--version"]:
            from osl_env import __version__

            print(f"osl-env {__version__}")
        else:
            _parse(words).execute()
        sys.stdout.flush()
    except InputError as error:
        return _complain(str(error), 2)
    except KeyboardInterrupt as stop:
        return _complain(str(stop) or "stopped", 130)
    except BrokenPipeError:  # the reader of the output, `head` for one, has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return 0


def _complain(message: str, code: int) -> int:
    print(f"osl: {' '.join(message.split())}", file=sys.stderr)
    return code


def _parse(words: list[str]) -> Listing | Run | Bench | Train | Reproduce | Plume:
    """The command that `words` mean. Raises InputError, in one line, where tyro would draw a box."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                Command,
                prog="osl",
                description=DESCRIPTION,
                args=words,
                config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
            )
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        raise InputError(_unboxed(said.getvalue())) from None


def _unboxed(box: str) -> str:
    """The message in one of tyro's error boxes, on one line: all sections but the help texts."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", box)
    lines = [line.strip(" │|") for line in plain.splitlines() if not re.match(r"\s*[╭╰+]", line)]
    sections = re.split(r"\n?[─-]{5,}\n?", "\n".join(lines))
    told = [" ".join(part.split()) for part in sections if part and not re.match(r"For full help|Argument help", part)]
    return f"{'; '.join(told) or 'cannot be understood'} (see osl --help)"


if __name__ == "__main__":
    sys.exit(main())
