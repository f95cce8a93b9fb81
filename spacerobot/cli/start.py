"""Where the ``spacerobot`` command begins: Ctrl-C ends it with one line even while its libraries load."""

import os
import sys

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


def main() -> None:
    """Load the command line and run it."""
    try:
        from spacerobot.cli.app import main as run

        run()
    except KeyboardInterrupt:
        # what prints in colours may not be loaded yet
        os.write(2, b"error: interrupted\n")
        sys.exit(INTERRUPTED)
