"""The survey of the console's map: measured once, in a process beside the console, and kept in its folder."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from console.errors import ConflictError
from console.map_geometry.survey import SURVEY_VERSION, Survey, load_survey
from navcore.errors import InputError, MappingError

MAX_SURVEY_S = 15 * 60.0
"""What has not been measured by then is given up; five million points take half a minute."""


class Surveys:
    """Has the map measured when somebody first asks. All methods may be called from any thread."""

    def __init__(self, site_folder: Path, checksum: str, folder: Path) -> None:
        """``checksum`` names the map (:func:`navcore.site.map_checksum`); ``folder`` keeps what was measured."""
        self._site_folder, self._checksum, self._folder = site_folder, checksum, folder
        self._file = folder / f"{checksum[:32]}-{SURVEY_VERSION}.npz"
        self._lock = threading.Lock()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="survey")
        self._survey: Future[Survey] | None = None
        self._process: subprocess.Popen[str] | None = None
        self._closed = False
        self.percent = 0
        """How far it has come."""

    def survey(self, timeout_s: float | None = None) -> Survey:
        """Return the survey, and wait for it; what has failed is tried again.

        Raises ConflictError where it is not done by then or the console ends, MappingError where it cannot be measured.
        """
        with self._lock:
            if self._closed:
                raise ConflictError("The console is ending: ask again when it is back.")
            has_failed = self._survey is not None and self._survey.done() and self._survey.exception() is not None
            if self._survey is None or has_failed:
                self.percent = 0
                self._survey = self._thread.submit(self._measured)
            survey = self._survey
        try:
            return survey.result(timeout_s)
        except TimeoutError as error:
            raise ConflictError(f"The map is being measured ({self.percent} %): ask again in a moment.") from error

    def close(self) -> None:
        """End what is being measured; it is begun anew after the next start."""
        with self._lock:
            self._closed = True
            if self._process is not None and self._process.poll() is None:
                self._process.kill()
        self._thread.shutdown()

    def _measured(self) -> Survey:
        with contextlib.suppress(InputError):
            return load_survey(self._file)
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            for broken_off in self._folder.glob(".*.npz.*"):
                broken_off.unlink(missing_ok=True)
            self._run()
            return load_survey(self._file)
        except (OSError, InputError) as error:
            raise MappingError(f"The map could not be measured ({error}): ask again.") from error

    def _run(self) -> None:
        command = [
            sys.executable, "-m", "console.map_geometry.survey", str(self._site_folder), str(self._file),
            "--checksum", self._checksum,
        ]  # fmt: skip
        with tempfile.TemporaryFile("w+", encoding="utf-8") as complaints:
            with self._lock:
                if self._closed:
                    raise ConflictError("The console is ending: ask again when it is back.")
                self._process = process = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=complaints, text=True,
                    # One core is left to those who are being led; Ctrl-C is the console's alone.
                    env={**os.environ, "OMP_NUM_THREADS": "1"}, start_new_session=True,
                )  # fmt: skip
            self._follow(process)
            if process.returncode != 0:
                complaints.seek(0)
                said = complaints.read()[-400:].strip() or f"it ended with {process.returncode}"
                raise MappingError(f"The map could not be measured: {said}")

    def _follow(self, process: subprocess.Popen[str]) -> None:
        timer = threading.Timer(MAX_SURVEY_S, process.kill)
        timer.daemon = True
        timer.start()
        try:
            assert process.stdout is not None
            for line in process.stdout:
                self.percent = int(line) if line.strip().isdigit() else self.percent
            process.wait()
        finally:
            timer.cancel()
