"""A recorder that plays what was recorded before: a rehearsal of a measurement."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from struck.errors import RecordingError
from struck.files import wav
from struck.files.sound import Sound
from struck.recordings.capture.capture import Take


class SimulatedRecorder:
    """Gives the WAV file of each take's name from a folder.

    A second attempt is given "name.2.wav" where there is one, a third "name.3.wav" ...; else the
    same again.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def record(self, take: Take, seconds: float, lead_in: float, cue: Callable[[], None]) -> Sound:
        """Return the file of a take, at most `seconds` of it.

        Raises
        ------
        RecordingError
            When there is none.
        FileFormatError
            When it is no WAV file.
        """
        del lead_in
        usual = self.folder / take.file
        again = usual.with_suffix(f".{take.attempt}.wav")
        path = again if again.is_file() else usual
        try:
            data = path.read_bytes()
        except OSError as error:
            raise RecordingError(
                f"{path} cannot be read ({error.strerror or error}): a rehearsal needs a WAV file "
                "for each take"
            ) from error
        cue()
        heard = wav.decode(data, str(path))
        length = round(seconds * heard.sample_rate)
        return Sound(samples=heard.samples[:, :length], sample_rate=heard.sample_rate)
