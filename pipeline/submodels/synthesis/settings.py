"""Settings of the synthesis of signals: training of the generator, and its limits."""

from dataclasses import dataclass, field
from typing import Annotated

from pipeline.nets.dcgan_settings import GanSettings, GanTraining
from pipeline.nets.settings import Whole
from pipeline.schema.ranges import Count, Positive, Range, Ranged


@dataclass(frozen=True, kw_only=True)
class SynthesisFitSettings(Ranged, section="synthesis_fit"):
    """How the generator is trained, and the learners that look at its windows.

    Parameters
    ----------
    network : GanSettings
        Sizes of generator and discriminator.
    training : GanTraining
        Its budget.
    trainings : int
        Generators of as many seeds, trained side by side: the first serves, and from all of them,
        at the last look and at the end, it is known how far trainings differ.
    by_tool : bool
        Whether the tool is a condition too; of one that was not learnt the mean of those that were
        takes its place.
    left_out : tuple of str
        Conditions of the windows that are none of the generator's, beside the tool's use, which
        would tell the wear.
    windows : int
        Training windows at most, evenly over each tool's life.
    trees : int
        Of each random forest.
    wears : int
        Wears, evenly over what was learnt, at which the judge's curve is read.
    looks : int
        Steps, evenly over the training, at which the first judge's curve is read.
    each : int
        Generated windows of each of these wears.
    judged : int
        Windows of a case that are compared at most, evenly over the tool's life.
    neighbours : int
        Nearest windows that span the neighbourhood of one, for density and coverage.
    seed : int
        Of noise and forests.
    """

    network: GanSettings = field(default_factory=GanSettings)
    training: GanTraining = field(default_factory=GanTraining)
    trainings: Count = 1
    by_tool: bool = True
    left_out: tuple[str, ...] = ()
    windows: Annotated[int, Range(least=20)] = 20_000
    trees: Count = 100
    wears: Annotated[int, Range(least=3)] = 20
    looks: Count = 4
    each: Annotated[int, Range(least=2)] = 40
    judged: Annotated[int, Range(least=5)] = 200
    neighbours: Count = 5
    seed: Whole = 0


@dataclass(frozen=True, kw_only=True)
class SynthesisLimits(Ranged, section="synthesis_limits"):
    """Limits on tools that the generator was not trained on.

    Parameters
    ----------
    rmse_um : float
        Greatest RMSE of the judge's wear of generated windows against the wear that was asked for
        [um]: a fifth of the usual criterion of 300 um (ISO 8688-2).
    rmse_class : float
        Greatest RMSE of the share of worn tools that the judge gives generated windows, where wear
        is a class [1]; a coin has 0.5.
    spread_percent : float
        Greatest difference of the distance between generated windows of the same conditions from
        that between recorded ones [%]; a collapsed generator has 100.
    copy_percent : float
        Greatest difference of the distance between a generated window and the nearest training
        window from that of a recorded one of a tool that was held out [%]; a copy has 100.
    """

    rmse_um: Positive = 60.0
    rmse_class: Positive = 0.5
    spread_percent: Positive = 70.0
    copy_percent: Positive = 80.0
