"""Which part of the tool is engaged at each angle, from the columns that were counted, compiled."""

from pipeline.cutting.sweep_formed import SKIN
from pipeline.kernels import compiled

_SIDE_CELLS = 0.25


@compiled
def profile(forms, tool, swept, met, cosines, plunge, floor, deepest, cell, mean, lower, depth):  # type: ignore[no-untyped-def]
    """Fill ``lower`` and ``depth`` [m] at each angle; returns the greatest depth.

    The slices that are met at an angle are taken as one piece of their height altogether, about
    their centre of gravity; ``floor`` is how far the underside of the stock is above the tip.
    """
    many, peak = forms.many[tool], 0.0
    start = max(floor, forms.bottom[tool, many])
    for k in range(many + 1):
        full = forms.thick[tool, k] if k < many else deepest - start
        _means(swept[k], met[k], cosines, plunge, forms.across[tool, k] / cell, full, mean[k])
    for a in range(depth.shape[0]):
        height = mean[many, a]
        moment = height * (start + 0.5 * height)
        for k in range(many):
            height += mean[k, a]
            moment += mean[k, a] * 0.5 * (forms.bottom[tool, k] + forms.bottom[tool, k + 1])
        depth[a] = height if height > SKIN else 0.0
        begin = moment / height - 0.5 * height if height > SKIN else 0.0
        lower[a] = begin if begin > SKIN else 0.0
        peak = max(peak, depth[a])
    return peak


@compiled
def _means(swept, met, cosines, plunge, radius, full, mean):  # type: ignore[no-untyped-def]
    """Material over columns at each angle; one that no column met has its neighbour's.

    Neighbours are those nearer to the direction of feed, where there are most columns.  At the
    sides of a tool of ``radius`` cells angles are far narrower than a cell, seen along the feed:
    those within a part of a cell are taken together.  ``full``: greatest depth met [m].
    """
    bins, material = swept.shape[0], 0.0
    for a in range(bins):
        material += met[a]
        mean[a] = 0.0
    if material == 0.0:
        return
    after = bins if plunge else bins // 2
    middle, start, side = after // 2, 0.0, 0
    if not plunge:
        while side < middle and radius * (1.0 - cosines[side]) < _SIDE_CELLS:
            side += 1
    for off in range(middle):
        count = swept[middle - 1 - off] + swept[middle + off]
        if count > 0.0:
            start = (met[middle - 1 - off] + met[middle + off]) / count
            break
    value = start
    for a in range(middle, after - side):
        value = met[a] / swept[a] if swept[a] > 0.0 else value
        mean[a] = value
    _side(swept, met, cosines, after - 1, side, value, full, mean)
    value = start
    for a in range(middle - 1, side - 1, -1):
        value = met[a] / swept[a] if swept[a] > 0.0 else value
        mean[a] = value
    _side(swept, met, cosines, 0, side, value, full, mean)
    for a in range(after, bins):
        mean[a] = met[a] / swept[a] if swept[a] > 0.0 else 0.0


@compiled
def _side(swept, met, cosines, outermost, many, neighbour, full, mean):  # type: ignore[no-untyped-def]
    """The ``many`` angles at a side together, from ``outermost`` on to the front.

    Where the angle next to them is not engaged, what is engaged of them, ``full`` deep, lies on the
    outside: how far it reaches follows from how much it is.
    """
    inward = 1 if outermost == 0 else -1
    count, total = 0.0, 0.0
    for off in range(many):
        count += swept[outermost + inward * off]
        total += met[outermost + inward * off]
    value = total / count if count > 0.0 else neighbour
    outside = neighbour < 0.5 * full and value < full
    reach = (1.0 - cosines[many]) * value / full if outside else 0.0
    for off in range(many):
        width = cosines[off] - cosines[off + 1]
        share = min(max((reach - 1.0 + cosines[off]) / width, 0.0), 1.0)
        mean[outermost + inward * off] = full * share if outside else value
