"""Files cut short, with bytes that flipped or in another encoding: an error or the truth."""

import time
from pathlib import Path

import numpy as np
import pytest
from recording_samples import HIT, RATE, ROOT, SAMPLES, TIP, N, sample
from test_formats import NEEDS, ROUNDED

from iwanjax.errors import InputError
from iwanjax.signals import Recording, read_recordings

PLACES = 50
FEW = 6
LONGEST = 20.0  # s; a sample of 256 values takes some ms
ENCODINGS = ["utf-16", "utf-16-le", "utf-8-sig", "utf-7", "cp037", "cp1252"]
TEXTS = ["hit.uff", "hit.lvm", "hit.csv", "hit.json"]


def opened(path) -> tuple[Recording, ...]:
    """What a file gives; nothing where it is refused in one line that names it."""
    start = time.perf_counter()
    try:
        return read_recordings(path)
    except InputError as error:
        message = str(error)
        assert "\n" not in message
        assert str(path) in message
        return ()
    finally:
        assert time.perf_counter() - start < LONGEST


def is_true(found: Recording, name: str) -> bool:
    """Whether it is the beginning of the sample's channels, on the sample's grid."""
    scale = 0.5 if name == "hit.wav" else 1.0
    near = max(ROUNDED.get(name, 0.0), 1e-12)
    columns = [found.response[:, i] for i in range(len(found.channels))]
    if found.force is not None:
        columns.append(found.force[:, 0])
    size = min(found.size, N)
    known = [scale * each[:size] for each in (TIP, ROOT, HIT, HIT / 10.0)]
    return (
        found.size <= N
        and abs(found.sampling_rate / RATE - 1.0) < 1e-6
        and all(any(np.allclose(x, y, atol=10 * near) for y in known) for x in columns)
    )


def written(tmp_path, name):
    if Path(name).suffix in NEEDS:
        pytest.importorskip(NEEDS[Path(name).suffix])
    path = sample(tmp_path, name)
    (recording,) = opened(path)
    assert is_true(recording, name)
    return path, path.read_bytes()


def check_cuts(path, content, name, places):
    for size in np.linspace(0, len(content) - 1, places).astype(int):
        path.write_bytes(content[:size])
        for recording in opened(path):
            # What still opens lost its last rows, or no more than what follows the numbers.
            assert is_true(recording, name), size


def check_flips(path, content, places):
    random = np.random.default_rng(0)
    # Headers are where a flipped byte does most.
    starts = random.integers(0, [min(len(content), 600), len(content)], (places, 2)).ravel()
    for at in starts:
        flipped = bytearray(content)
        flipped[at] ^= 1 << int(random.integers(8))
        path.write_bytes(flipped)
        for recording in opened(path):
            assert np.all(np.isfinite(recording.response))


@pytest.mark.parametrize("name", SAMPLES)
def test_a_file_cut_anywhere(tmp_path, name):
    check_cuts(*written(tmp_path, name), name, FEW)


@pytest.mark.parametrize("name", SAMPLES)
def test_a_file_with_a_flipped_bit(tmp_path, name):
    check_flips(*written(tmp_path, name), FEW)


@pytest.mark.parametrize("name", TEXTS)
def test_text_of_another_encoding(tmp_path, name):
    path, content = written(tmp_path, name)
    for encoding in ENCODINGS:
        path.write_bytes(content.decode().encode(encoding))
        for recording in opened(path):
            assert is_true(recording, name)


@pytest.mark.long
@pytest.mark.parametrize("name", SAMPLES)
def test_a_file_damaged_at_many_places(tmp_path, name):
    path, content = written(tmp_path, name)
    check_cuts(path, content, name, PLACES)
    check_flips(path, content, PLACES)


@pytest.mark.parametrize("suffix", sorted({Path(name).suffix for name in SAMPLES}))
def test_a_file_of_another_kind(tmp_path, suffix):
    """Named by mistake, empty or of noise."""
    noise = np.random.default_rng(1).bytes(4096)
    for content in (b"", b"\n", noise, b"time,acc\n0,1\n", b"\x89HDF\r\n\x1a\n" + noise):
        path = tmp_path / f"x{suffix}"
        path.write_bytes(content)
        assert opened(path) == ()
