"""First-order recursions in time, in compiled form: lags and thermal networks of two modes.

Arrays have time last, ``T`` samples; a state at a sample is that at the beginning of its step.
"""

from pipeline.kernels import compiled


@compiled
def follow(decay, drive, answer):  # type: ignore[no-untyped-def]
    """``answer`` (T, C), whose first row is given: y[k + 1] = decay[k] y[k] + drive[k]."""
    for k in range(len(decay)):
        for c in range(answer.shape[1]):
            answer[k + 1, c] = decay[k] * answer[k, c] + drive[k, c]


@compiled
def run_modes(  # type: ignore[no-untyped-def]
    sources, heating, given, inverse, vectors, decay, gain, start, nodes
):
    """Temperatures of two nodes, ``nodes`` (2, N, T), from the modes of their network.

    ``sources`` (N, T, S) heat the nodes by ``heating`` (2, S) [K/s per unit of the source],
    ``given`` (2, N, T) is what drives them besides [K/s]; ``vectors`` (2, 2) are the modes,
    ``inverse`` takes nodes to modes, ``decay`` and ``gain`` (2,) are those of a mode over a step,
    ``start`` (N, 2) are the nodes at the first sample.
    """
    a, b, c, d = inverse[0, 0], inverse[0, 1], inverse[1, 0], inverse[1, 1]
    for n in range(sources.shape[0]):
        fast = a * start[n, 0] + b * start[n, 1]
        slow = c * start[n, 0] + d * start[n, 1]
        for t in range(sources.shape[1]):
            nodes[0, n, t] = vectors[0, 0] * fast + vectors[0, 1] * slow
            nodes[1, n, t] = vectors[1, 0] * fast + vectors[1, 1] * slow
            own, body = given[0, n, t], given[1, n, t]
            for s in range(sources.shape[2]):
                own += heating[0, s] * sources[n, t, s]
                body += heating[1, s] * sources[n, t, s]
            fast = decay[0] * fast + gain[0] * (a * own + b * body)
            slow = decay[1] * slow + gain[1] * (c * own + d * body)
