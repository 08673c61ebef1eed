"""The spectrum of a voxel grid at any frequency: an oversampled FFT and a short interpolation kernel.

The kernel is the "exponential of semicircle" exp(beta (sqrt(1 - (2 t / w)^2) - 1)).  Voxels are divided by its
transform in advance, which makes the interpolation exact except for aliases from beyond the oversampled grid (about
exp(-pi w sqrt(1 - 1 / oversampling)), 2e-5 here).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..runtime.jit import kernel, prange

TAPS = 6
OVERSAMPLING = 1.5
BETA = math.pi * TAPS * (1.0 - 0.5 / OVERSAMPLING)
HALO = TAPS // 2 + 1  # columns beyond both ends of the half spectrum, so that no tap wraps around along x


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The spectrum of a padded grid.

    Attributes
    ----------
    values : (mz, my, mx / 2 + 1 + 2 HALO) complex64
        The transform; column HALO is frequency 0 along x.
    size : (3,) int64
        Padded voxels along x, y, z.
    center : (3,) float64
        The voxel index that the phases refer to.
    """

    values: np.ndarray
    size: np.ndarray
    center: np.ndarray

    @property
    def nbytes(self) -> int:
        """Bytes of the values."""
        return self.values.nbytes


def fast_size(least: int) -> int:
    """The smallest even number of at least ``least`` without prime factors above 5."""
    size = max(least + least % 2, 2)
    while True:
        rest = size
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return size
        size += 2


def _kernel_transform(frequencies: np.ndarray) -> np.ndarray:
    """The Fourier transform of the interpolation kernel at frequencies in cycles per grid step."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    shape = np.exp(BETA * (np.sqrt(1.0 - nodes**2) - 1.0))
    turns = 2.0 * np.pi * np.asarray(frequencies)[:, None] * (0.5 * TAPS * nodes)
    return 0.5 * TAPS * (np.cos(turns) @ (weights * shape))


def transform(voxels: np.ndarray) -> Spectrum:
    """The spectrum of a real grid (nz, ny, nx), slice by slice, in little more memory than the result takes."""
    counts = voxels.shape
    sizes = [fast_size(max(math.ceil(OVERSAMPLING * n), n + TAPS)) for n in counts]
    centers = [n // 2 for n in counts]
    positions, scales = [], []
    for n, size, center in zip(counts, sizes, centers):
        away = np.arange(n) - center
        positions.append(away % size)
        scales.append(1.0 / _kernel_transform(away / size))
    half = sizes[2] // 2 + 1
    values = np.zeros((sizes[0], sizes[1], half + 2 * HALO), np.complex64)
    core = values[:, :, HALO : HALO + half]
    plane = np.zeros((sizes[1], sizes[2]), np.float32)
    for k in range(counts[0]):
        plane[np.ix_(positions[1], positions[2])] = voxels[k] * (scales[0][k] * scales[1][:, None] * scales[2])
        core[positions[0][k]] = np.fft.rfft2(plane)
    for j in range(sizes[1]):
        core[:, j] = np.fft.fft(core[:, j], axis=0)
    # The spectrum of a real grid at -f is the conjugate of that at f; this fills the columns beyond both ends.
    opposite = [-np.arange(size) % size for size in sizes[:2]]
    for i in range(1, HALO + 1):
        values[:, :, HALO - i] = np.conj(core[:, :, i][np.ix_(*opposite)])
        values[:, :, HALO + half - 1 + i] = np.conj(core[:, :, half - 1 - i][np.ix_(*opposite)])
    return Spectrum(values, np.array(sizes[::-1], np.int64), np.array(centers[::-1], np.float64))


@kernel(inline="always")
def _taps(position, weights):
    """The first grid point of the interpolation kernel around ``position``; writes its TAPS ``weights``."""
    first = math.ceil(position - 0.5 * TAPS)
    for i in range(TAPS):
        t = (first + i - position) * (2.0 / TAPS)
        weights[i] = math.exp(BETA * (math.sqrt(max(1.0 - t * t, 0.0)) - 1.0))
    return first


@kernel(parallel=True)
def look_up(values, size, frequencies, across, down, out):
    """out[b, a] = the spectrum at ``across[a] * frequencies[0] + down[b] * frequencies[1]``, in cycles per voxel.

    ``values``, ``size``: see ``Spectrum``.  ``frequencies``: (2, 3) float64, x, y, z.  ``across`` (A,) and ``down``
    (B,) float64.  ``out``: (B, A) complex64, phases relative to the spectrum's center.
    """
    for b in prange(down.size):
        wx, wy, wz = np.empty(TAPS), np.empty(TAPS), np.empty(TAPS)
        position = np.empty(3)
        for a in range(across.size):
            for axis in range(3):
                f = across[a] * frequencies[0, axis] + down[b] * frequencies[1, axis]
                position[axis] = f - math.floor(f + 0.5)  # the spectrum of samples repeats every cycle per voxel
            turned = position[0] < 0.0
            sign = -1.0 if turned else 1.0
            x0 = _taps(sign * position[0] * size[0], wx) + HALO
            y0 = _taps(sign * position[1] * size[1], wy)
            z0 = _taps(sign * position[2] * size[2], wz)
            real, imaginary = 0.0, 0.0
            for k in range(TAPS):
                z = (z0 + k) % size[2]
                for j in range(TAPS):
                    y = (y0 + j) % size[1]
                    weight = wz[k] * wy[j]
                    for i in range(TAPS):
                        value = values[z, y, x0 + i]
                        real += weight * wx[i] * value.real
                        imaginary += weight * wx[i] * value.imag
            out[b, a] = complex(real, -imaginary if turned else imaginary)
