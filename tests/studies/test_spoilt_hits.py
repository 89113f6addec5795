"""One spoilt hit among sound ones is left out with a word; a study of spoilt hits alone ends."""

import numpy as np
import pytest

import iwanjax as ij

RATE = 2000.0
T = np.arange(4000) / RATE
DECAY = np.exp(-2.0 * T) * np.cos(2.0 * np.pi * 100.0 * T)
SPOILT = np.clip(DECAY, -0.4, 0.4)


def study(folder, hits):
    lines = ["name: hits", "model: {modal: [{name: m, band: [70, 140], joint: {type: iwan4}}]}"]
    lines.append("recordings:")
    for i, hit in enumerate(hits):
        np.savez(folder / f"hit{i}.npz", time=T, vel=hit)
        lines.append(f"  - {{file: hit{i}.npz, kind: free_decay, response: {{channel: vel}}}}")
    (folder / "study.yaml").write_text("\n".join(lines))
    return ij.load_study(folder / "study.yaml")


def test_a_spoilt_hit_is_left_out_with_a_word(tmp_path):
    mode = study(tmp_path, [DECAY, SPOILT, 0.7 * DECAY]).curves().only
    assert [hit.name for hit in mode.hits] == ["hit0.npz", "hit2.npz"]
    (told,) = mode.skipped
    assert "study.yaml:5: recordings[1]: hit1.npz: signal is clipped" in told
    assert "m: left out " in mode.summary()


def test_spoilt_hits_alone_end_the_study(tmp_path):
    with pytest.raises(ij.InputError, match=r"recordings\[0\]: hit0.npz: signal is clipped"):
        study(tmp_path, [SPOILT]).curves()


def test_what_is_remarked_on_a_decay_is_in_the_summary(tmp_path):
    driven = np.concatenate([np.sin(2.0 * np.pi * 100.0 * T), DECAY])
    lines = study(tmp_path, [DECAY])
    np.savez(tmp_path / "hit0.npz", time=np.arange(driven.size) / RATE, vel=driven)
    assert "something drives it" in lines.curves().only.summary()
