"""Every tuned number has one place, is read from there, and can be replaced."""

import ast
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from pathlib import Path

import pytest

import iwanjax
from iwanjax.discrepancy.judgement import Misfit, judged
from iwanjax.settings.judgement import JudgementSettings
from iwanjax.settings.stages import Settings, settings, using

PACKAGE = Path(iwanjax.__file__).parent


def numbers(stage):
    """Names of all numbers, those of stages within a stage as well."""
    for each in fields(stage):
        value = getattr(stage, each.name)
        yield from numbers(value) if is_dataclass(value) else [each.name]


def attributes_read():
    """Names of attributes that the rooms that diagnose read, but for the settings' own."""
    rooms = ("discrepancy", "identification", "effects", "signals")
    return {
        node.attr
        for room in rooms
        for path in (PACKAGE / room).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load)
    }


def test_every_number_is_read():
    assert set(numbers(Settings())) <= attributes_read()


def test_other_numbers_decide_within_their_block_only():
    def doubt():
        return judged(0.0, [100.0], Misfit(30.0, 30.0), Misfit(3.0, 3.0)).something_else

    usual = doubt()
    with using(replace(Settings(), judgement=JudgementSettings(neighbour=0.2))):
        assert settings().judgement.neighbour == 0.2
        # Twice the share for which half the doubt is left: odds of 2^4 less.
        fallen = doubt()
    assert fallen / (1.0 - fallen) == pytest.approx(usual / (1.0 - usual) / 2.0**4)
    assert doubt() == usual


def test_a_failure_within_the_block_leaves_the_usual_numbers():
    with pytest.raises(ValueError, match="lost"), using(Settings(JudgementSettings(sure=1.0))):
        raise ValueError("lost")
    assert settings() == Settings()


def test_settings_are_frozen_and_keys_of_compiled_kernels():
    assert hash(Settings()) == hash(Settings())
    with pytest.raises(FrozenInstanceError):
        Settings().judgement.sure = 1.0  # type: ignore[misc]
