"""Progress of a long run, for people."""

from __future__ import annotations

import html
import sys
from typing import Any, TextIO


class Progress:
    """Shows the events of a run: ``quadrille.run(case, out, on_event=quadrille.Progress())``.

    In a notebook a bar that stays in it as a line; else a bar of tqdm where that is installed (``pip install quadrille[progress]``), or
    a line that changes.
    """

    def __init__(self, file: TextIO | None = None, notes: bool = True) -> None:
        """Writes to ``file`` (standard error, or the notebook); with ``notes`` what the run has to say, too."""
        self._file, self._notes = file, notes
        self._notebook = file is None and "ipykernel" in sys.modules
        self._shown: Any = None
        self._bar: Any = None
        self._total: int | None = None
        self._done = 0
        self._text = ""

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
                self._line(f"{self._done} of {self._total or '?'} frames", self._done / (self._total or self._done))
        elif kind == "fitting":
            omega, instant = event["omega"], event["instant"]
            value = "" if omega is None else f"; omega {omega:.4e}"
            share = None if instant is None else instant / max(event["n_instants"], 1)
            if instant is None or self._notebook:
                self._line(f"{event['doing']}: {event['evaluation']} forward runs, {event['seconds']:.0f} s{value}", share)
        elif kind in ("note", "remark") and self._notes:
            self._say("warning: " * (event.get("severity") == "warning") + event["text"])
        elif kind in ("finished", "identified", "simulated", "compared"):
            self._close()

    def _open(self) -> Any:
        if self._notebook:
            return None
        try:
            from tqdm import tqdm
        except ImportError:
            return None
        return tqdm(total=self._total, initial=self._done, unit="frame", file=self._file)

    def _line(self, text: str, share: float | None = None, bar: bool = True) -> None:
        self._text = text
        if not self._notebook:
            print(f"\r{text:<79}", end="", file=self._file or sys.stderr, flush=True)
            return
        from IPython.display import HTML, display

        value = "" if share is None else f" value='{share:.4f}'"
        page = HTML(f"<progress max='1'{value}></progress> " * bar + html.escape(text))  # type: ignore[no-untyped-call, unused-ignore]
        if self._shown is None:
            self._shown = display(page, display_id=True)  # type: ignore[no-untyped-call, unused-ignore]
        else:
            self._shown.update(page)

    def _say(self, text: str) -> None:
        if self._notebook:
            print(text)
        elif self._bar is not None:
            self._bar.write(text, file=self._file or sys.stderr)
        else:
            print(f"\r{text:<79}", file=self._file or sys.stderr, flush=True)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None
        elif self._text and self._notebook:
            # A bar that is left would move for ever.
            self._line(self._text, bar=False)
            self._shown = None
        elif self._text:
            print(file=self._file or sys.stderr, flush=True)
        self._text = ""
