"""Stored cutting-force models, and the names of the quantities that they predict.

Forces act on the tool along feed, normal and axis; harmonics are those of the spindle's revolution.
Numbers are SI where their names carry no unit.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees
from typing import Any

from pipeline.schema.model import Correlation, LeftOut, Model, Parameter
from pipeline.schema.si import MM

COEFFICIENTS = ""
"""Group of the parameters of the waveform: coefficients, runout, helix, Kienzle's constants."""
MEAN_FORCE = "mean force"
"""Group of the coefficients that the mean forces give."""
SPINDLE = "spindle"
"""Group of what the spindle's load gives: no-load power p0, p1, p2, specific_force, K_tc, K_te."""
CHANNEL = "channel "
"""Prefix of a dynamometer's channel: group of its natural frequency and damping."""

CHANNELS = ("x", "y", "z")
"""Channels of a dynamometer."""
PLANE = "force in the plane of the feed"
"""Quantity: components along and across the feed, one after the other, over the angle [deg]."""
MAGNITUDE = "magnitude of the force in the plane"
"""Quantity: its magnitude over the angle of the spindle [deg]."""
PEAK, MEAN = "peak force in the plane", "mean force in the plane"
"""Quantities: greatest and mean magnitude over a revolution, one value for each recording."""
BY_LOAD = "mean tangential force by the spindle's load"
"""Quantity: beside that of the dynamometer, one value for each recording [N]."""
BY_LOAD_SHARE = "tangential force by the spindle's load, dynamometer 100"
"""Quantity: the same over that of the dynamometer [%]; its mean error is the MAPE."""
CHANNEL_FORCE = "force "
"""Prefix of a channel: quantity of the force that it measures."""
OTHERS = "fitted on other recordings"
"""Regime of a training recording as a fit without it predicts it."""
MECHANICS, PLAIN = "mechanics", "plain"
"""Baselines: the model without the waveform residual; coefficients of the mean forces alone."""

Harmonics = tuple[tuple[tuple[float, float], ...], ...]
"""Real and imaginary part by harmonic and direction; shape (H + 1, 3, 2)."""


@dataclass(frozen=True, kw_only=True)
class CutConditions:
    """Conditions of a cut."""

    speed: float
    """Spindle speed n [rev/s]."""
    f_z: float
    """Feed per tooth [m]."""
    a_p: float
    """Axial depth of cut [m]."""
    phi_st: float
    phi_ex: float
    """Entry and exit angle of the teeth [rad]."""
    flutes: int
    """Number of teeth."""

    @property
    def feed(self) -> float:
        """Feed rate [m/s]."""
        return self.f_z * self.flutes * self.speed

    @property
    def stated(self) -> dict[str, float]:
        """Speed [rev/min], feed per tooth and axial depth [mm], entry and exit [deg], by name."""
        return {
            "speed_rpm": 60 * self.speed, "feed_per_tooth_mm": self.f_z / MM,
            "axial_depth_mm": self.a_p / MM, "entry_deg": degrees(self.phi_st),
            "exit_deg": degrees(self.phi_ex),
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ToolGeometry:
    """Runout and helix of a tool, the part of its shape that may be identified."""

    along: float = 0.0
    across: float = 0.0
    """Runout: offset of the tool's axis towards the first tooth, and a quarter turn after it
    [m]."""
    helix: float = 0.0
    """Helix angle [rad]."""


@dataclass(frozen=True, kw_only=True)
class StoredResidual:
    """Residual of the mechanics under one set of conditions, affine in the feed per tooth."""

    conditions: CutConditions
    """Conditions of the first of its recordings."""
    feeds_m: tuple[float, ...]
    """Feeds per tooth of its recordings [m]."""
    constant_N: Harmonics
    slope_N_m: Harmonics
    """Harmonics at no feed [N], and their slope over the feed per tooth [N/m]."""


@dataclass(frozen=True, kw_only=True)
class ChipLaw:
    """Force of an edge for each width of chip, C h (h / 50 um)^(-m) + E (1 - exp(-h / h_0))."""

    cutting: tuple[float, ...]
    edge: tuple[float, ...]
    """C [N/m^2] and E [N/m], tangential, radial, axial."""
    exponent: tuple[float, ...]
    """m of each direction [1]."""
    growth: float
    """h_0 [m]; 0 for an edge force that is there at once."""


@dataclass(frozen=True, kw_only=True)
class ForceSpread:
    """Draws of the chip law that predictions average over, and what widens their intervals."""

    laws: tuple[ChipLaw, ...]
    """Draws that the records allow, each as likely as the others."""
    line: tuple[float, ...]
    """Straight line over the recorded cuts that they depart from, six coefficients [N/m^2], [N/m]:
    that of a predicting law that bends, else the mean of theirs."""
    gain: float
    wear: float
    """Spread from recording to recording of depth, gain and edge force [1]."""
    zero_N2: float
    """Variance of a mean force by the zeros [N^2]."""
    feeds_m: tuple[float, float]
    speeds: tuple[float, float]
    depths_m: tuple[float, float]
    """Least and greatest feed per tooth [m], spindle speed [rev/s] and axial depth [m] that were
    learnt."""
    peak_scale: float = 1.0
    mean_scale: float = 1.0
    shape_scale: float = 1.0
    """Errors of peak, mean and waveform on recordings left out, over what was expected [1]."""
    freedom: int = 4
    """Degrees of freedom of these."""


@dataclass(frozen=True, kw_only=True)
class StoredCutModel:
    """Everything that a prediction of forces needs, in full precision."""

    tool: Mapping[str, Any]
    """Fields of :class:`pipeline.cutting.tool.Tool`."""
    geometry: ToolGeometry
    """Runout and helix of the tool."""
    values: tuple[float, ...]
    """Six constants of its law [N/m^2], [N/m], determined or not; then edge forces of single
    teeth."""
    natural_Hz: tuple[float, ...] | None
    damping: tuple[float, ...] | None
    """Modes of the channels that measure feed, normal and axis [Hz], [1]."""
    left_out_N2: tuple[float, ...]
    """Variance of the model error of each direction's harmonics [N^2]."""
    residuals: tuple[StoredResidual, ...] = ()
    """Residuals under trained conditions."""
    spread: ForceSpread | None = None
    """Laws and errors that its intervals are made of; None without intervals."""
    growth_m: float = 0.0
    exponent: float = 0.0
    """Thickness over which the edge's force grows [m], and exponent of the size effect [1], of its
    law; both 0 for a straight line."""
    line: tuple[float, ...] = ()
    """Six coefficients of its law's straight line over the recorded cuts [N/m^2], [N/m]; empty for
    those in ``values``."""


@dataclass(frozen=True, kw_only=True)
class FoldModel:
    """A fit without some of the training recordings; both are named."""

    left_out: tuple[str, ...]
    fitted_on: tuple[str, ...]
    prediction: StoredCutModel


@dataclass(frozen=True, kw_only=True)
class CuttingFitFacts:
    """Quality of the waveform's fit."""

    rms_error_percent: float
    """RMS residual over the RMS force [%]."""
    samples: int
    revolutions: int
    """Real numbers that were fitted; revolutions of the training recordings."""
    condition: float
    """Condition number of the scaled Jacobian [1]."""
    left_out_N: tuple[float, ...]
    """Standard deviation of the model error of each direction's harmonics [N]."""
    zero_N: float
    """Standard deviation of the zeros beyond that stated with the recordings [N]."""


@dataclass(frozen=True, kw_only=True)
class TermsTried:
    """Terms of a model, their error on recordings left out [1] or criterion, and whether kept."""

    terms: tuple[str, ...]
    value: float
    kept: bool


@dataclass(frozen=True, kw_only=True)
class MethodTried:
    """Error [%] and evaluations of a method of optimisation on the same waveforms."""

    method: str
    rms_error_percent: float
    evaluations: int


@dataclass(frozen=True, kw_only=True)
class ResidualConditions:
    """Conditions under which the waveform residual was identified, and the feeds it is used for."""

    speed_rpm: float
    axial_depth_mm: float
    entry_deg: float
    exit_deg: float
    feeds_per_tooth_mm: tuple[float, ...]
    holds_for_mm: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class CutRecording:
    """Recording of a dynamometer; numbers are None where they are not known.

    ``role``: ``"training"``, ``"judged"`` or ``"left out"``, with the reason; ``fault``: cause of
    its difference.
    """

    recording: str
    role: str
    reason: str = ""
    fault: str = ""
    notes: tuple[str, ...] = ()
    speed_rpm: float | None = None
    feed_mm_min: float | None = None
    feed_per_tooth_mm: float | None = None
    axial_depth_mm: float | None = None
    entry_deg: float | None = None
    exit_deg: float | None = None
    revolutions: int = 0


@dataclass(frozen=True, kw_only=True)
class NoLoadPoint:
    """No-load power of the spindle at one speed: fitted, half of its 95 % interval, measured."""

    speed_rpm: float
    power_W: float
    half_width_95_W: float
    measured_W: float


@dataclass(frozen=True, kw_only=True)
class CutLevel:
    """One level of cutting power above the no-load power, with what it removed meanwhile."""

    speed_rpm: float
    removal_rate_cm3_min: float
    power_W: float
    deviation_W: float
    specific_force_N_mm2: float
    samples: int


@dataclass(frozen=True, kw_only=True)
class SpindleLoad:
    """Identification from logs of the spindle's load; its parameters are those of ``SPINDLE``."""

    recordings: tuple[str, ...]
    """Logs that were used."""
    reason: str
    """Reason of a missing result."""
    assumed: str
    """Premises: meaning of the load, rated power and efficiency."""
    range_rpm: tuple[float, float] | None = None
    """Speeds between which the no-load power holds [rev/min]."""
    curve: tuple[NoLoadPoint, ...] = ()
    """The levels without a cut."""
    cuts: tuple[CutLevel, ...] = ()
    """The levels of cutting."""
    left_out: tuple[LeftOut, ...] = ()
    """Logs that were not used, with the reason."""
    notes: tuple[str, ...] = ()
    """Notes on the part of a log that was not used."""


@dataclass(frozen=True, kw_only=True)
class CuttingModel(Model):
    """The content of cutting's ``model.json``."""

    method: str
    """Method of the optimum: ``"least_squares"`` or ``"genetic"``."""
    reason: str
    """Reason why there are no coefficients, or why they cannot be right."""
    material: str
    """Material of the workpiece."""
    tool: Mapping[str, Any]
    """Fields of :class:`pipeline.cutting.tool.Tool`."""
    remarks: Mapping[str, str]
    """Remarks on the meaning of a determined parameter, by its name."""
    correlation: Correlation
    """Correlation of the waveform's unknowns."""
    fit: CuttingFitFacts | None
    """Facts of the fit; None without one."""
    terms: tuple[TermsTried, ...]
    methods: tuple[MethodTried, ...]
    """Models and methods that were compared."""
    residual_conditions: tuple[ResidualConditions, ...]
    """Conditions under which the waveform residual is part of the model."""
    recordings: tuple[CutRecording, ...]
    """All recordings of the dynamometer."""
    prediction: StoredCutModel | None
    plain: StoredCutModel | None
    """The model; and the plain guess beside it, coefficients of the mean forces without helix,
    runout and modes."""
    folds: tuple[FoldModel, ...]
    """Fits without some of the training recordings."""
    spindle: SpindleLoad | None
    """Identification from spindle load; None without logs of it."""

    @property
    def coefficients(self) -> Mapping[str, Parameter]:
        """Coefficients, runout, helix and Kienzle's constants by name; empty without a fit."""
        return self.parameters.get(COEFFICIENTS, {})

    @property
    def mean_force(self) -> Mapping[str, Parameter]:
        """Coefficients of the mean forces."""
        return self.parameters.get(MEAN_FORCE, {})

    @property
    def spindle_parameters(self) -> Mapping[str, Parameter]:
        """No-load power and specific force of the spindle's load."""
        return self.parameters.get(SPINDLE, {})

    @property
    def channels(self) -> Mapping[str, Mapping[str, Parameter]]:
        """Natural frequency and damping by the letter of the dynamometer's channel."""
        return {
            group.removeprefix(CHANNEL): rows
            for group, rows in self.parameters.items()
            if group.startswith(CHANNEL)
        }
