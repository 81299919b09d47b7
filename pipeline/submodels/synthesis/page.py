"""Page of the generated signals: their wear by the readers, their use in training."""

from collections.abc import Iterator

from pipeline.charts.cases import Drawn
from pipeline.charts.numbers import counted, joined, number
from pipeline.charts.submodel_page import Counting, PageContent, declared
from pipeline.charts.words import page_words
from pipeline.submodels.synthesis import judging
from pipeline.submodels.synthesis.figures import Seen, amount, model_figures, spectra
from pipeline.submodels.synthesis.model import SynthesisModel

WORDS = page_words(__file__)


def content(shown: Seen) -> PageContent:
    """Page content of generated signals."""
    model = shown.model
    judges = [""] if model is None or not model.judges else model.judges
    judge = judges[0]
    return declared(
        WORDS,
        about=WORDS(
            "about", windows="windows" if model is None else counted(model.windows, "window"),
            simulated="simulated " * (shown.origin == "simulated"),
        ),
        rules=WORDS.content["rules"] + (WORDS("read_by", judge=judge) if judge else ""),
        counts=[
            Counting(key="generated_wear_mae", name=WORDS("count.mae"), quantity=judging.GENERATED,
                     regime=judge, error="mae", whole=True),
            *(Counting(key=f"generated_wear_rmse_{k}" if k else "generated_wear_rmse",
                       name=WORDS("count.rmse_by" if name else "count.rmse", judge=name),
                       quantity=judging.GENERATED, regime=name) for k, name in enumerate(judges)),
        ],
        todo=WORDS.table("todo", machine=shown.machine),
        titles=judging.TITLES,
        facts=[_augmentation(shown), *([] if model is None else _curve_words(shown, model))],
        notes=[] if model is None else list(model.faults),
        figures=[] if model is None else [model_figures(shown, model)],
        drawn=[Drawn(quantity=judging.GENERATED, regime=judge, error="mae", axis=WORDS("use"),
                     other=(judging.RECORDED, WORDS("recorded")))],
        of_judgement=[] if model is None else [spectra(shown, model)],
    )  # fmt: skip


def _augmentation(shown: Seen) -> str:
    """Whether generated windows help to learn the wear of recorded ones."""
    skills = () if shown.verdict is None else shown.verdict.skills
    pair = judging.AUGMENTED, judging.RECORDED
    one = next((s for s in skills if (s.quantity, s.baseline) == pair and s.mae is not None), None)
    if one is None or one.mae is None:
        return ""
    ends, way = one.mae_interval_95, 1.0 if one.mae > 0 else -1.0
    if ends is None:
        interval, use = WORDS("help.few", tools=counted(one.groups, "tool")), ""
    else:
        low, high = sorted(100 * way * end for end in ends)
        interval = WORDS("help.interval", low=number(low), high=number(high))
        use = WORDS("help.harm") if ends[1] < 0 else ""
    if ends is None or ends[0] <= 0 <= ends[1]:
        use = WORDS("help.unsure")
    return WORDS("help.lowers" if one.mae > 0 else "help.raises", interval=interval, use=use,
                 change=number(100 * abs(one.mae)))  # fmt: skip


def _curve_words(shown: Seen, model: SynthesisModel) -> Iterator[str]:
    """Reading of the wear by each reader, and its course in training."""
    recorded = {}
    if shown.predictions is not None and shown.verdict is not None:
        recorded = judging.recorded_readings(shown.predictions, shown.verdict.judged_role)
    for name, one in model.curves.items():
        words = WORDS(
            "curve.text", wears=counted(len(one.asked), "wear"), first=number(one.asked[0]),
            last=amount(model, one.asked[-1]), judge=name, slope=number(one.slope),
            rank=number(one.rank_correlation), rank_of_means=number(one.rank_of_means),
        )  # fmt: skip
        if name in recorded:
            slope, rank = recorded[name]
            words += WORDS("curve.recorded", slope=number(slope), rank=number(rank))
        if one.false_intervals:
            where = joined([f"{number(a)} to {number(b)}" for a, b in one.false_intervals])
            words += WORDS("curve.falls", where=where)
        yield words
    if len(model.looks) > 1:
        looks = joined([WORDS("looks.one", error=amount(model, one.mae), steps=one.step)
                        for one in model.looks])  # fmt: skip
        yield WORDS("looks.text", judge=model.judges[0], looks=looks)
