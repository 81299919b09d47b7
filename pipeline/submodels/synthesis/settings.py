"""Settings of the synthesis of signals: training of the generator, and its limits."""

from dataclasses import dataclass, field
from typing import Annotated

from pipeline.nets.dcgan_settings import GanSettings, GanTraining
from pipeline.nets.settings import Whole
from pipeline.schema.ranges import Count, Positive, Range, Ranged


@dataclass(frozen=True, kw_only=True)
class SynthesisFitSettings(Ranged, section="synthesis_fit"):
    """Training of the generator, and of the learners that look at its windows."""

    network: GanSettings = field(default_factory=GanSettings)
    """Sizes of generator and discriminator."""
    training: GanTraining = field(default_factory=GanTraining)
    """Its budget."""
    trainings: Count = 1
    """Generators of as many seeds, trained side by side: the first serves, and from all of them, at
    the last look and at the end, it is known how far trainings differ."""
    by_tool: bool = True
    """Whether the tool is a condition too; of one that was not learnt the mean of those that were
    takes its place."""
    left_out: tuple[str, ...] = ()
    """Conditions of the windows that are none of the generator's, beside the tool's use, which
    would tell the wear."""
    windows: Annotated[int, Range(least=20)] = 20_000
    """Training windows at most, evenly over each tool's life."""
    trees: Count = 100
    """Trees of each random forest."""
    wears: Annotated[int, Range(least=3)] = 20
    """Wears, evenly over what was learnt, at which the judge's curve is read."""
    looks: Count = 4
    """Steps, evenly over the training, at which the first judge's curve is read."""
    each: Annotated[int, Range(least=2)] = 40
    """Generated windows of each of these wears."""
    judged: Annotated[int, Range(least=5)] = 200
    """Windows of a case that are compared at most, evenly over the tool's life."""
    neighbours: Count = 5
    """Nearest windows that span the neighbourhood of one, for density and coverage."""
    seed: Whole = 0
    """Seed of noise and forests."""


@dataclass(frozen=True, kw_only=True)
class SynthesisLimits(Ranged, section="synthesis_limits"):
    """Limits on tools that the generator was not trained on."""

    rmse_um: Positive = 60.0
    """Greatest RMSE of the judge's wear of generated windows against the wear that was asked for
    [um]: a fifth of the usual criterion of 300 um (ISO 8688-2)."""
    rmse_class: Positive = 0.5
    """Greatest RMSE of the share of worn tools that the judge gives generated windows, where wear
    is a class [1]; a coin has 0.5."""
    spread_percent: Positive = 70.0
    """Greatest difference of the distance between generated windows of the same conditions from
    that between recorded ones [%]; a collapsed generator has 100."""
    copy_percent: Positive = 80.0
    """Greatest difference of the distance between a generated window and the nearest training
    window from that of a recorded one of a tool that was held out [%]; a copy has 100."""
