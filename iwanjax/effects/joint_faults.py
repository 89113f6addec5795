"""Faults of joints: one that sticks, drifts, was left out, or is moved by several modes."""

from dataclasses import replace

from iwanjax.effects.kinds import ChannelKind, JointKind, ModeKind, missing
from iwanjax.joints import AttachedOscillator, Iwan4, ParameterInfo
from iwanjax.joints.force_law import WITHIN_K

_LEFT_OUT = JointKind(
    "iwan_joint",
    "a joint left out",
    Iwan4.parameters,
    "microslip where no joint is",
    "a joint",
    missing("a joint"),
    more=True,
    element=Iwan4,
)
JOINT_FAULTS = (
    JointKind(
        "stiction",
        "static and kinetic friction that differ",
        (ParameterInfo("theta", "1", "kinetic over static friction", 0.0, upper=1.0),),
        "less damping after large amplitudes than the joint's growth would have it",
        "static friction above the kinetic one",
        "Joint {where} has more static than kinetic friction",
    ),
    JointKind(
        "joint_drift",
        "bolt loosening, wear-in, temperature",
        (
            ParameterInfo("F_S_change", "1", "of ln F_S from recording to recording"),
            ParameterInfo("K_T_change", "1", "of ln K_T from recording to recording"),
        ),
        "recordings that each want another strength of one joint",
        "a change from recording to recording",
        "Joint {where} changes from recording to recording",
    ),
    _LEFT_OUT,
    replace(
        _LEFT_OUT,
        sentence=f"{_LEFT_OUT.sentence}, {WITHIN_K.words}",
        variant=WITHIN_K.words,
        within=True,
    ),
    JointKind(
        "attached_oscillator",
        "something unmodelled that resonates",
        AttachedOscillator.parameters,
        "a resonance that the model has not, and one beside it that is split or shifted",
        "an attached oscillator",
        missing("an attached oscillator"),
        more=True,
        law=AttachedOscillator,
    ),
    ModeKind(
        "modal_coupling",
        "a joint that several modes move at once",
        ParameterInfo("ratio", "1", "the joint's deflection by the other mode over that by this"),
        "hits that differ at equal amplitude, the lower in frequency the more another mode moves",
        "another mode that moves the joint",
        "The joint of {where} is moved by another mode as well",
    ),
    *(
        ChannelKind(
            f"{name}_by_channel",
            f"{strength} that depends on a channel",
            "loops that are alike but for a channel",
            f"a {strength} that depends on a channel",
            f"The {strength} of {{where}} depends on a channel",
            strength,
            moved,
        )
        # Friction of a normal force or a voltage, springs of a temperature; both together change
        # as one force. Shapes of a joint are not known to depend on any.
        for name, strength, moved in (
            ("slip_force", "slip force", "F_S"),
            ("joint_stiffness", "stiffness", "K_T"),
            ("joint_force", "whole force", ""),
        )
    ),
)
"""What is wrong with a model's joints."""
