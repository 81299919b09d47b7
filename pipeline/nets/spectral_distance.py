"""Energy distance between spectra of recorded and generated windows: a proper score of a generator.

E = d(x, y) + d(x, y') - d(y, y'), with a recorded window x and two generated ones y, y' at its
conditions.  Its expectation is least where the windows have the recorded distribution at those
conditions.  Phases do not count: d looks at magnitudes of short spectra.

Source: Gritsenko et al. 2020, A spectral energy distance for parallel speech synthesis.
"""

from functools import cache

import torch
from torch import Tensor

FLOOR = 1e-3
"""Magnitude below which a line counts as silence, of a window inside -1..1 [1]."""
SHARES = (1, 4, 16)
"""The short spectra are of the whole window, and of these parts of it or less, each half over the
next and of a power of two."""
SHORTEST = 16
"""Samples of the shortest spectrum."""


def short_spectra(x: Tensor) -> list[Tensor]:
    """Magnitudes of windows (N, C, L) in short spectra, one tensor (N, F, C, B) a length."""
    length = x.shape[2]
    found = []
    for part in sorted({_part(length, share) for share in SHARES}):
        frames = x.unfold(2, part, max(part // 2, 1)).transpose(1, 2)  # (N, F, C, part)
        if part < length:  # so short that a product with the waves is faster
            real, imaginary = (frames @ _waves(part, x.device)).chunk(2, dim=-1)
        else:
            real, imaginary = torch.view_as_real(torch.fft.rfft(frames, norm="forward")).unbind(-1)
        found.append(2.0 * torch.sqrt(real * real + imaginary * imaginary + FLOOR**2))
    return found


@cache
def _waves(part: int, device: torch.device) -> Tensor:
    """Cosines, then sines, of the lines of a spectrum under a Hann window, (part, 2 lines)."""
    t = torch.arange(part, dtype=torch.float64)[:, None]
    angle = 2.0 * torch.pi / part * t * torch.arange(part // 2 + 1)
    shape = torch.hann_window(part, dtype=torch.float64)[:, None] / part
    return (shape * torch.cat([angle.cos(), angle.sin()], dim=1)).to(torch.float32).to(device)


def _part(length: int, share: int) -> int:
    if share == 1 or length <= SHORTEST:
        return length
    return max(2 ** ((length // share).bit_length() - 1), SHORTEST)


def distances(a: list[Tensor], b: list[Tensor]) -> Tensor:
    """Distance of each window of ``a`` from that of ``b`` by their short spectra, shape (N,)."""
    total = a[0].new_zeros(len(a[0]))
    for one, other in zip(a, b, strict=True):
        plain = (one - other).abs().sum(dim=(2, 3)) / one.shape[2]
        apart = one.log() - other.log()
        level = (apart * apart).mean(dim=(2, 3))
        total = total + (plain + torch.sqrt(level + 1e-12)).mean(dim=1)
    return total / len(a)


def energy_distance(real: Tensor, one: Tensor, other: Tensor) -> Tensor:
    """Mean energy distance of windows (N, C, L) from two generated ones at the same conditions."""
    x, y, z = short_spectra(real), short_spectra(one), short_spectra(other)
    means = [part.mean(dim=2) for part in (real, one, other)]
    level = _apart(means[0], means[1]) + _apart(means[0], means[2]) - _apart(means[1], means[2])
    return (distances(x, y) + distances(x, z) - distances(y, z) + level).mean()


def _apart(a: Tensor, b: Tensor) -> Tensor:
    """Distance of means (N, C)."""
    return torch.sqrt((a - b).square().sum(dim=1) + 1e-12)
