"""What is heard: tones in their place, words where there is a voice, each cue at its own time."""

from __future__ import annotations

import io
import sys
import threading
import types
import wave
from pathlib import Path

import numpy as np
import pytest

from device_agent.adapters.outputs import TextOutput
from device_agent.adapters.sound_device import SoundDeviceOutput
from device_agent.adapters.wav_file import WavFileOutput
from navcore.cue_sound import render_cue
from navcore.cues.directions import DirectionStyle, move_text, told_move_deg, told_turn_deg, turn_text
from navcore.cues.synthesis import steer_cue, stop_cue, tick_cue
from navcore.cues.table import Cue, CueKind, CuePriority
from navcore.cues.texts import EXPLANATIONS, STOP_TEXTS, TEXTS, Language, speech_duration_s
from navcore.errors import InputError, SensorError
from navcore.espeak import SAMPLE_RATE_HZ, Speech
from navcore.types import Reason

QUIET_PLACE = 1e-4


def read_wav(path: Path) -> np.ndarray:
    with wave.open(str(path)) as sound:
        assert (sound.getnchannels(), sound.getsampwidth(), sound.getframerate()) == (2, 2, SAMPLE_RATE_HZ)
        raw = sound.readframes(sound.getnframes())
    return np.frombuffer(raw, "<i2").reshape(-1, 2) / 32768.0


def loudness(samples: np.ndarray) -> float:
    return float(np.sqrt((samples**2).mean())) if samples.size else 0.0


def test_a_steering_tone_is_louder_on_its_side() -> None:
    left, right = render_cue(steer_cue(0.0, 40.0), Speech()), render_cue(steer_cue(0.0, -40.0), Speech())
    assert loudness(left[:, 0]) > 3 * loudness(left[:, 1])
    assert loudness(right[:, 1]) > 3 * loudness(right[:, 0])


def test_each_cue_sounds_at_its_time_and_the_next_cuts_it_off(tmp_path: Path) -> None:
    path = tmp_path / "walk.wav"
    long_tone = Cue(12.0, CueKind.STEER, CuePriority.TURN, frequency_hz=800.0, duration_s=3.0, pan=-1.0)
    output = WavFileOutput(path, Speech(), begin_s=10.0)
    output.play(long_tone)
    output.play(Cue(13.0, CueKind.STEER, CuePriority.TURN, frequency_hz=800.0, duration_s=0.5, pan=1.0))
    output.play(tick_cue(16.0))
    output.close()
    heard = read_wav(path)

    def between(begin_s: float, end_s: float) -> np.ndarray:
        return heard[round(begin_s * SAMPLE_RATE_HZ) : round(end_s * SAMPLE_RATE_HZ)]

    assert loudness(between(0.0, 2.0)) < QUIET_PLACE
    assert loudness(between(2.1, 2.9)[:, 0]) > 0.1
    assert loudness(between(3.05, 3.4)[:, 0]) < QUIET_PLACE
    assert loudness(between(3.05, 3.4)[:, 1]) > 0.1
    assert loudness(between(3.6, 6.0)) < QUIET_PLACE
    assert loudness(between(6.0, 6.05)) > 0.05


def test_words_are_spoken_and_different_words_sound_different() -> None:
    speech = Speech()
    if not speech.available:
        pytest.skip("espeak-ng is not installed")
    stop, turn = speech.samples("Stop."), speech.samples("Turn left 30 degrees.")
    assert 0.2 * SAMPLE_RATE_HZ < len(stop) < len(turn) < 4 * SAMPLE_RATE_HZ
    assert loudness(stop) > 0.01
    assert loudness(turn) > 0.01
    assert np.array_equal(stop, speech.samples("Stop."))
    assert len(speech.samples("--help")) > 0
    assert len(speech.samples("向左转30度。")) > 0.3 * SAMPLE_RATE_HZ


@pytest.mark.parametrize("style", ["degrees", "clock", "sides"])
@pytest.mark.parametrize("language", ["en", "zh"])
def test_every_direction_is_spoken_and_takes_about_as_long_as_it_is_said_to(
    language: Language, style: DirectionStyle, tmp_path: Path
) -> None:
    """What espeak-ng makes of it, in the WAV file that a walk writes."""
    speech = Speech(language)
    if not speech.available:
        pytest.skip("espeak-ng is not installed")
    texts = [turn_text(told_turn_deg(angle, style), style, language) for angle in (0.2, -0.8, 1.6, -2.4, 3.1)]
    texts += [move_text(told_move_deg(angle, 10.0, style), style, language) for angle in (0.0, -0.3)]
    for index, text in enumerate(dict.fromkeys(texts)):
        path = tmp_path / f"{index}.wav"
        output = WavFileOutput(path, speech, begin_s=0.0)
        output.play(Cue(0.0, CueKind.TURN, CuePriority.TURN, text))
        output.close()
        heard = read_wav(path)
        assert loudness(heard) > 0.01, text
        np.testing.assert_array_equal(heard[:, 0], heard[:, 1])
        assert speech_duration_s(text, language) == pytest.approx(len(heard) / SAMPLE_RATE_HZ, rel=0.3), text


@pytest.mark.parametrize("language", ["en", "zh"])
def test_all_texts_together_take_as_long_as_they_are_said_to(language: Language) -> None:
    speech = Speech(language)
    if not speech.available:
        pytest.skip("espeak-ng is not installed")
    texts = [*STOP_TEXTS[language].values(), *EXPLANATIONS[language].values()]
    texts += [text for text in TEXTS[language].values() if "{" not in text]
    said_s = sum(speech_duration_s(text, language) for text in texts)
    assert said_s == pytest.approx(sum(len(speech.samples(text)) for text in texts) / SAMPLE_RATE_HZ, rel=0.1)


@pytest.mark.parametrize(("language", "style"), [("en", "clock"), ("zh", "sides")])
def test_without_a_voice_directions_are_text_and_tones(
    language: Language, style: DirectionStyle, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    text = turn_text(told_turn_deg(1.0, style), style, language)
    stream = io.StringIO()
    TextOutput(stream).play(Cue(0.0, CueKind.TURN, CuePriority.TURN, text))
    assert text in stream.getvalue()
    assert not Speech(language).available
    assert loudness(render_cue(stop_cue(0.0, Reason.PAUSED, language), Speech(language))) > 0.1


def test_without_a_voice_words_are_silent(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    speech = Speech()
    assert not speech.available
    assert len(render_cue(Cue(0.0, CueKind.STOP, CuePriority.STOP, "Stop."), speech)) == 0


def test_a_place_that_cannot_be_written_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "walk.wav").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        WavFileOutput(tmp_path / "walk.wav", Speech())


def test_the_last_cue_is_heard_out_and_what_would_be_cut_off_at_once_is_skipped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On a stand-in for the package sounddevice: there is no earphone where tests run."""
    calls: list[tuple[str, int]] = []
    rendering, go_on = threading.Event(), threading.Event()

    def play(samples: np.ndarray, rate_hz: int) -> None:
        calls.append(("play", len(samples)))
        rendering.set()
        assert go_on.wait(10.0)

    fake = types.SimpleNamespace(
        check_output_settings=lambda **_: None, play=play, stop=lambda: calls.append(("stop", 0)),
        wait=lambda: calls.append(("wait", 0)),
    )  # fmt: skip
    monkeypatch.setitem(sys.modules, "sounddevice", fake)
    output = SoundDeviceOutput(Speech())
    first, last = tick_cue(0.0), steer_cue(0.3, 40.0)
    output.play(first)
    assert rendering.wait(10.0)
    for cue in (tick_cue(0.1), tick_cue(0.2), last):
        output.play(cue)
    go_on.set()
    output.close()
    assert calls == [("play", len(render_cue(first, Speech()))), ("play", len(render_cue(last, Speech()))), ("wait", 0)]


def test_a_system_without_portaudio_is_told_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The package is there, and fails as it does where the system's library is missing."""
    (tmp_path / "sounddevice.py").write_text('raise OSError("PortAudio library not found")\n')
    monkeypatch.delitem(sys.modules, "sounddevice", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SensorError, match="apt-get install libportaudio2"):
        SoundDeviceOutput(Speech())


def test_a_disk_that_is_full_ends_the_sound_file_and_nothing_else(tmp_path: Path) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("this system has no /dev/full")
    output = WavFileOutput(full, Speech(), begin_s=0.0)
    for second in range(20):
        output.play(tick_cue(float(second)))
    output.close()
    output.play(tick_cue(30.0))
    output.close()
