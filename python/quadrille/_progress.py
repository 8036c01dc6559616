"""Progress of a long run, for people."""

from __future__ import annotations

import sys
from typing import Any, TextIO


class Progress:
    """Shows the events of a run: ``quadrille.run(case, out, on_event=quadrille.Progress())``.

    A bar of tqdm where that is installed (``pip install quadrille[progress]``; in a notebook its own), else a line that changes.
    """

    def __init__(self, file: TextIO | None = None, notes: bool = True) -> None:
        """Writes to ``file`` (standard error); with ``notes`` what the run has to say, too."""
        self._file, self._notes = file, notes
        self._bar: Any = None
        self._total: int | None = None
        self._done = 0

    def __call__(self, event: dict[str, Any]) -> None:
        """Takes an event."""
        kind = event["event"]
        if kind == "begun":
            self._total, self._done = event["total"], event["before"]
            self._bar = self._open()
        elif kind == "frame":
            self._done += 1
            if self._bar is not None:
                self._bar.update(1)
            else:
                self._line(f"{self._done} of {self._total or '?'} frames")
        elif kind == "fitting" and event["instant"] is None:
            omega = event["omega"]
            value = "no solution" if omega is None else f"omega {omega:.4e}"
            self._line(f"{event['doing']}: {event['evaluation']} forward runs, {event['seconds']:.0f} s; {value}")
        elif kind in ("note", "remark") and self._notes:
            self._say("warning: " * (event.get("severity") == "warning") + event["text"])
        elif kind in ("finished", "identified", "simulated", "compared"):
            self._close()

    def _open(self) -> Any:
        try:
            from tqdm.auto import tqdm
        except ImportError:
            return None
        return tqdm(total=self._total, initial=self._done, unit="frame", file=self._file)

    def _line(self, text: str) -> None:
        print(f"\r{text:<79}", end="", file=self._file or sys.stderr, flush=True)

    def _say(self, text: str) -> None:
        if self._bar is not None:
            self._bar.write(text, file=self._file or sys.stderr)
        else:
            print(f"\r{text:<79}", file=self._file or sys.stderr, flush=True)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None
        elif self._done:
            print(file=self._file or sys.stderr, flush=True)
