"""Joint elements: one file each, pure and elementwise, knowing no structure."""

from iwanjax.joints.abstract import AbstractJoint, Law, ParameterInfo
from iwanjax.joints.attached_oscillator import AttachedOscillator
from iwanjax.joints.background import PowerLawDamping
from iwanjax.joints.backlash import Backlash
from iwanjax.joints.bouc_wen import BoucWen
from iwanjax.joints.catalogue import JOINTS, described, joint_type, register_joint
from iwanjax.joints.changing_stiffness import ChangingStiffness
from iwanjax.joints.dashpot import Dashpot
from iwanjax.joints.discrete import AbstractDiscrete, Reaction
from iwanjax.joints.drag import QuadraticDrag
from iwanjax.joints.force_law import AbstractForceLaw, NestedLaw, PlaceMotion, Scales
from iwanjax.joints.fronts import SlipFronts
from iwanjax.joints.hysteresis import hysteresis
from iwanjax.joints.inertia import Inertia
from iwanjax.joints.iwan import DISTRIBUTION_PARAMETERS
from iwanjax.joints.iwan4 import Iwan4
from iwanjax.joints.iwan5 import Iwan5
from iwanjax.joints.jenkins import Jenkins
from iwanjax.joints.masing import masing_dissipation, masing_loading
from iwanjax.joints.maxwell import Maxwell
from iwanjax.joints.reversals import Reversals
from iwanjax.joints.sliders import SliderBank
from iwanjax.joints.springs import (
    BilinearSpring,
    CubicSpring,
    Gap,
    LinearSpring,
    QuadraticSpring,
)
from iwanjax.joints.stepped import AbstractStepped
from iwanjax.joints.tabulated import Tabulated
from iwanjax.joints.tanh_spring import TanhSpring
from iwanjax.joints.unnamed import UnnamedLaw

__all__ = [
    "DISTRIBUTION_PARAMETERS",
    "JOINTS",
    "AbstractDiscrete",
    "AbstractForceLaw",
    "AbstractJoint",
    "AbstractStepped",
    "AttachedOscillator",
    "Backlash",
    "BilinearSpring",
    "BoucWen",
    "ChangingStiffness",
    "CubicSpring",
    "Dashpot",
    "Gap",
    "Inertia",
    "Iwan4",
    "Iwan5",
    "Jenkins",
    "Law",
    "LinearSpring",
    "Maxwell",
    "NestedLaw",
    "ParameterInfo",
    "PlaceMotion",
    "PowerLawDamping",
    "QuadraticDrag",
    "QuadraticSpring",
    "Reaction",
    "Reversals",
    "Scales",
    "SliderBank",
    "SlipFronts",
    "Tabulated",
    "TanhSpring",
    "UnnamedLaw",
    "described",
    "hysteresis",
    "joint_type",
    "masing_dissipation",
    "masing_loading",
    "register_joint",
]
