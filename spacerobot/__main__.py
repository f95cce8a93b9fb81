"""``python -m spacerobot``: the command line."""

from spacerobot.cli.start import main

if __name__ == "__main__":
    main()
