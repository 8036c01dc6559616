"""The program ``quadrille``: ``quadrille --help``, or ``python -m quadrille --help``."""

import os
import signal
import sys

from ._quadrille import command


def main() -> int:
    """Runs the command line of this process; its exit status."""
    # The program has its own answer to Ctrl-C: it ends what it is at, and the same command goes on from there.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # Without a desktop session the drivers of Mesa complain; into this folder nobody can put a socket (`quiet_drivers` of the program).
    if sys.platform == "linux":
        os.environ.setdefault("XDG_RUNTIME_DIR", "/proc/self")
    return command(sys.argv)


if __name__ == "__main__":
    sys.exit(main())
