"""What a sound run of a scene stays within, derived before anything is measured.

**Overlap.** A contact in front of the cylinder carries F = 15 P d^2 in the mean (`tank`), and in a
tube 0.9 sigma d^2; forces in a bed are distributed exponentially, so the largest of n contacts is
near (1 + ln n) F. With three contacts a grain that gives a static overlap. To it comes that of an
impact, elastic, at the speed at which grains meet. No grain may be half-way through another: that
bound is the only one in the plane, where the drag, and with it the largest force, is what is
looked for, and in a sheared cell, whose overlaps are over the least side of a grain, and deepest in
the first strain, before the grains lie alike.

**Agitation.** Nothing moves faster, against the mean and in the mean square, than what drives it
or than a fall over which grains come together, or, sheared, by what kinetic theory has beside it.

**Step.** `stability` has the limits. Two are given: the `earliest`, of a grain touched on all sides
(12 spheres, 6 discs) by contacts as deep as the bound, under which nothing can break; and the
`expected`, of a grain of a dense bed (6 contacts, 4 in the plane) at the overlap expected in front
of the cylinder or at the piston. In units of the `scale`, the time that the scene's step is a share
of.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import log, sqrt

from liftdrag import hertz
from liftdrag.granular import GRAVITY
from liftdrag.numerics import derive
from liftdrag.numerics.drag2d import SQUEEZE
from liftdrag.numerics.janssen import COMPACTION, GAP, MEAN_FORCE
from liftdrag.numerics.janssen import DEEPEST as DEEPEST_IN_TUBE
from liftdrag.numerics.shear import (
    critical_time,
    expected_overlap,
    least_side,
    least_stiffness,
)
from liftdrag.numerics.tank import DEEPEST, FRONT_STRESS, impact_speed, pressure
from liftdrag.scene import Drag2DScene, JanssenScene, Scene, ShearScene, TankScene
from liftdrag.scene.janssen import TANGENTIAL_RATIO, TubeGrains
from liftdrag.scene.material import Material
from liftdrag.stability import Crowd, damping_ratio, hertz_slope

SPHERES, DISCS = (12.0, 6.0), (6.0, 4.0)
"""Contacts of a grain: at the most, and in a dense bed."""

CONTACTS = 3.0
"""Contacts a grain of a dense bed, each counted once."""

HALF_WAY = 0.5
"""Overlap over the diameter of the smaller grain at which it is half-way through the other."""

HEATED = 0.6
"""Three times the root mean square speed of inelastic spheres in dilute shear flow, times the solid
fraction and sqrt(1 - e^2), over rate x d: kinetic theory's work, 5 sqrt(pi T)/96 rho d rate^2, is
its loss, (12/sqrt(pi)) (1 - e^2) rho fraction^2 T^1.5 / d."""

WALTON_BRAUN = 0.8
"""Its tangential stiffness over the normal one in loading."""


@dataclass(frozen=True)
class Bounds:
    """`scale` (s), by name, and the case's `own` step, the `earliest` and `expected` step that
    breaks as shares of it; the largest `overlap` over the diameter; the `agitation`, m/s."""

    name: str
    scale: float
    own: float
    earliest: float
    expected: float
    overlap: float
    agitation: float

    def lines(self) -> Iterator[str]:
        """The bounds in words."""
        yield f"Steps are shares of {self.name}, {self.scale:.3g} s; the case's is {self.own:.3g}."
        yield (
            f"Predicted to break at {self.expected:.2g}, in the worst surroundings at "
            f"{self.earliest:.2g}: 2/omega of the stiffest contacts, crowded and damped."
        )
        yield f"No overlap may exceed {self.overlap:.2g} d, no agitation {self.agitation:.2g} m/s."


def bounds_of(scene: Scene) -> Bounds:
    """The bounds of a scene. Raises CaseError when it has no numerics."""
    if isinstance(scene, TankScene):
        return _tank(scene)
    if isinstance(scene, JanssenScene):
        return _janssen(scene)
    return _shear(scene) if isinstance(scene, ShearScene) else _drag2d(scene)


def overlap_bound(scene: Scene) -> float:
    """The overlap over the diameter of the smaller grain that no sound run reaches."""
    if isinstance(scene, TankScene):
        return _tank_overlap(scene)
    return _tube_overlap(scene) if isinstance(scene, JanssenScene) else HALF_WAY


def agitation_bound(scene: Scene) -> float:
    """The root mean square speed (m/s) against the mean that no sound run reaches."""
    if isinstance(scene, TankScene):
        return impact_speed(scene)
    if isinstance(scene, JanssenScene):
        return max(scene.drive.speed or 0.0, _fall(GAP * scene.grains.diameter))
    if isinstance(scene, ShearScene):
        return _heated(scene)
    return scene.drive.speed


def _tank(scene: TankScene) -> Bounds:
    numerics, grains = derive(scene), scene.grains
    scale = min(numerics.rayleigh_time.value, numerics.hertz_time.value)
    overlaps = (overlap_bound(scene), numerics.overlap_ratio.value)
    slopes = [hertz_slope(grains.stiffness, share * grains.diameter) for share in overlaps]
    crowd = _hertz_crowd(grains, 3)
    name = "the smaller of the Rayleigh and Hertz times"
    return _bounds(scene, name, scale, crowd, SPHERES, slopes, grains.mass)


def _drag2d(scene: Drag2DScene) -> Bounds:
    grains, scale = scene.grains, derive(scene).squeezed_time.value
    overlaps = (overlap_bound(scene), SQUEEZE)
    slopes = [hertz_slope(grains.stiffness, share * grains.diameter) for share in overlaps]
    crowd, smallest = _hertz_crowd(grains, 2), scene.mass * (1.0 - grains.spread) ** 2
    return _bounds(scene, "the squeezed time", scale, crowd, DISCS, slopes, smallest)


def _janssen(scene: JanssenScene) -> Bounds:
    numerics, grains = derive(scene), scene.grains
    overlaps = (overlap_bound(scene), numerics.overlap_ratio.value)
    slopes = [_tube_slope(scene, share * grains.diameter) for share in overlaps]
    scale = numerics.contact_time.value
    return _bounds(
        scene, "the contact time", scale, _tube_crowd(grains), SPHERES, slopes, grains.mass
    )


def _shear(scene: ShearScene) -> Bounds:
    """Of the slenderest grains, touched at their ends."""
    k, side = least_stiffness(scene), least_side(scene)
    slopes = [
        hertz_slope(k, share * side) for share in (overlap_bound(scene), expected_overlap(scene))
    ]
    crowd = Crowd(1.0, 3, 0.0, _hertz_ratio(scene.grains.restitution))
    mass = scene.mass / _lever(scene)
    name = "the paper's critical time"
    return _bounds(scene, name, critical_time(scene), crowd, SPHERES, slopes, mass)


def _lever(scene: ShearScene) -> float:
    """1 + h^2 m / I at the most: how much more a contact at a distance h moves a grain there."""
    levers = []
    for species in scene.species:
        if species.is_sphere:
            levers.append(1.0)
            continue
        diameter, length = species.sides(scene.grains.diameter)
        inertia = length**2 / 12.0 + diameter**2 / 16.0
        levers.append(1.0 + max(length, diameter) ** 2 / 4.0 / inertia)
    return max(levers)


def _heated(scene: ShearScene) -> float:
    """Speed (m/s) of the cell's upper side, and that to which a dilute gas of spheres is heated."""
    dissipated = scene.solid_fraction * sqrt(1.0 - scene.grains.restitution**2)
    heated = HEATED * scene.grains.diameter / dissipated
    return scene.drive.shear_rate * (scene.sides[1] + heated)


def _bounds(
    scene: Scene,
    name: str,
    scale: float,
    crowd: Crowd,
    contacts: tuple[float, float],
    slopes: Sequence[float],
    mass: float,
) -> Bounds:
    """The steps of the slopes (N/m) of contacts at the bound and as expected."""
    earliest, expected = (
        replace(crowd, contacts=count).step(slope, mass) / scale
        for count, slope in zip(contacts, slopes, strict=True)
    )
    own = derive(scene).time_step.value / scale
    limits = overlap_bound(scene), agitation_bound(scene)
    return Bounds(name, scale, own, earliest, expected, *limits)


def _hertz_crowd(grains: Material, dimensions: int) -> Crowd:
    tangential = _mindlin(grains.poisson_ratio) if grains.friction else 0.0
    return Crowd(1.0, dimensions, tangential, _hertz_ratio(grains.restitution))


def _mindlin(poisson_ratio: float) -> float:
    """Tangential over normal stiffness of Hertz and Mindlin."""
    return 2.0 * (1.0 - poisson_ratio) / (2.0 - poisson_ratio)


def _hertz_ratio(restitution: float) -> float:
    return sqrt(5.0 / 6.0) * damping_ratio(restitution)


def _tube_crowd(grains: TubeGrains) -> Crowd:
    if grains.contact == "hertz":
        tangential = _mindlin(grains.poisson_ratio or 0.0)
        ratio = _hertz_ratio(grains.restitution)
    elif grains.contact == "linear":
        tangential, ratio = TANGENTIAL_RATIO, damping_ratio(grains.restitution)
    else:
        tangential, ratio = WALTON_BRAUN * grains.restitution**2, 0.0
    return Crowd(1.0, 3, tangential if grains.friction else 0.0, ratio)


def _tube_slope(scene: JanssenScene, overlap: float) -> float:
    """Stiffness (N/m) of a contact at this overlap (m), of Walton and Braun's in unloading."""
    grains, stiffness = scene.grains, derive(scene).stiffness.value
    if grains.contact == "hertz":
        return hertz_slope(grains.hertz_stiffness(stiffness), overlap)
    return stiffness / (grains.restitution**2 if grains.contact == "walton-braun" else 1.0)


def _tank_overlap(scene: TankScene) -> float:
    grains = scene.grains
    force = FRONT_STRESS * pressure(scene) * grains.diameter**2 * _largest(scene.grain_count)
    static = hertz.static_overlap(force, grains.stiffness)
    impact = hertz.impact_overlap(grains.stiffness, grains.mass / 2.0, impact_speed(scene))
    return min((static + impact) / grains.diameter, DEEPEST)


def _tube_overlap(scene: JanssenScene) -> float:
    """Of the whole run: its layers fall, and sag as they settle."""
    grains, numerics = scene.grains, derive(scene)
    force = MEAN_FORCE * numerics.largest_stress.value * grains.diameter**2
    force *= _largest(scene.grain_count)
    speed = _fall(COMPACTION * scene.height_of(scene.grain_count) + GAP * grains.diameter)
    stiffness, mass = numerics.stiffness.value, grains.mass / 2.0
    if grains.contact == "hertz":
        k = grains.hertz_stiffness(stiffness)
        overlap = hertz.static_overlap(force, k) + hertz.impact_overlap(k, mass, speed)
    else:
        overlap = force / stiffness + speed * sqrt(mass / stiffness)
    return min(overlap / grains.diameter, DEEPEST_IN_TUBE)


def _largest(grains: int) -> float:
    """The largest of the forces of so many grains over their mean."""
    return 1.0 + log(CONTACTS * grains)


def _fall(height: float) -> float:
    """Speed (m/s) after a fall."""
    return sqrt(2.0 * GRAVITY * height)
