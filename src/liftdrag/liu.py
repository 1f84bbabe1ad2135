"""Stresses of rods and disks against their alignment: Liu et al., Energies 13 (2020) 1841.

Over rho d_v^2 rate^2, S the order parameter averaged over the grains, nu the solid fraction:

    shear stress = exp(a_1 S + b_1),    pressure = exp(a_2 S + b_2),

and the bulk friction their ratio (eqs. 21 to 23): at nu = 0.5 with the numbers of Table 2,
otherwise with A_1 nu^3 + A_2 nu^2 + A_3 nu + A_4 of Table 3 (eq. 24). There the rows b_1 and a_2
are taken as swapped: as printed they give -4.09 and 2.55 at 0.5, for 2.24 and -3.38 in Table 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TABLE_2 = {"shear_stress": (-5.0174, 2.2389), "pressure": (-3.3785, 2.8122)}
"""a and b at a solid fraction of 0.5."""

TABLE_3 = {
    "shear_stress": ((3235.0, -4730.0, 2258.6, -356.60), (-2439.4, 3610.5, -1731.9, 270.80)),
    "pressure": ((2243.7, -3343.9, 1617.2, -257.18), (-1643.9, 2506.1, -1222.6, 193.67)),
}
"""A_1 to A_4 of a and of b, fitted to rods of ratio 6 and disks of 0.15."""

CURVES = (*TABLE_2, "bulk_friction")
"""What there is a curve of."""

FRACTIONS = (0.4, 0.55)
"""Solid fractions of the flows that Table 3 was fitted to."""

ALIGNED = 0.5
"""S above which the paper's flows fall on one curve, whatever the shapes."""

AT_HALF = 0.005
"""Distance from 0.5 within which Table 2 holds."""


@dataclass(frozen=True)
class Curve:
    """exp(a S + b), of an order parameter S."""

    a: float
    b: float

    def __call__(self, alignment: np.ndarray) -> np.ndarray:
        """The stress (n,) at each S (n,), over rho d_v^2 rate^2."""
        return np.asarray(np.exp(self.a * alignment + self.b))


def curve(quantity: str, solid_fraction: float) -> Curve | None:
    """The paper's curve of "shear_stress", "pressure" or "bulk_friction", their ratio.

    None outside the paper's solid fractions.
    """
    if quantity != "bulk_friction":
        return _fitted(quantity, solid_fraction)
    shear, pressure = (_fitted(name, solid_fraction) for name in TABLE_2)
    if shear is None or pressure is None:
        return None
    return Curve(shear.a - pressure.a, shear.b - pressure.b)


def _fitted(quantity: str, solid_fraction: float) -> Curve | None:
    if abs(solid_fraction - 0.5) <= AT_HALF:
        return Curve(*TABLE_2[quantity])
    least, most = FRACTIONS
    if not least - AT_HALF <= solid_fraction <= most + AT_HALF:
        return None
    return Curve(*(float(np.polyval(row, solid_fraction)) for row in TABLE_3[quantity]))
