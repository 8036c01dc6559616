"""The program ``quadrille``: ``quadrille --help``, or ``python -m quadrille --help``."""

import signal
import sys

from ._quadrille import command


def main() -> int:
    """Runs the command line of this process; its exit status."""
    # The program has its own answer to Ctrl-C: it ends what it is at, and the same command goes on from there.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return command(sys.argv)


if __name__ == "__main__":
    sys.exit(main())
