"""Start of the ``spacerobot`` command: Ctrl-C ends it with one line even while its libraries load."""

import gc
import os
import sys

from spacerobot.common.interrupts import INTERRUPTED, leave, minded


def main() -> None:
    """Load and run the command line."""
    # open a stream that was closed before (``>&-``), so that no file opened later takes its place
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115 (stays open)
    gc.set_threshold(50_000)  # else a tenth of a short command's time goes into looking for garbage
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
