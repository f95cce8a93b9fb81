"""Where the ``spacerobot`` command begins: Ctrl-C ends it with one line even while its libraries load."""

import sys

from spacerobot.interrupts import INTERRUPTED, leave, minded


def main() -> None:
    """Load the command line and run it."""
    if not any(argument.startswith("--dask") for argument in sys.argv):
        sys.modules.setdefault("dask", None)  # type: ignore[arg-type]  # else xarray loads it, for nothing
    try:
        with minded():
            from spacerobot.cli.app import main as run

            run()
    except KeyboardInterrupt:
        leave()
    except SystemExit as left:
        if left.code == INTERRUPTED:  # the command has said so
            sys.stdout.flush()
            leave("")
        raise
