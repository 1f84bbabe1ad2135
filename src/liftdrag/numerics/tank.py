"""The numerics of a tank, derived from its scene alone, each value with its reason."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, pi, sqrt

from liftdrag import granular, hertz
from liftdrag.errors import CaseError
from liftdrag.granular import GRAVITY
from liftdrag.numerics.restarts import restart_every
from liftdrag.numerics.value import Numerics, Value
from liftdrag.scene import TankScene
from liftdrag.scene.tank import SETTLED_FRACTION, TRANSIENT

STEP_FRACTION = 0.15
"""Time step over the smaller of the Rayleigh and Hertz times."""

STEP_BOUND = 0.2
"""The same ratio above which a time step set by hand is warned about."""

SETTLED = 1e-4
"""Kinetic energy per grain, over m g d, below which a bed is settled."""

SPRING_DAMPING = 16.0
"""Damping of a bed that was settled before, over that of one that is settling."""

SPRING_TIME = 0.1
"""How long such a bed rests at least, in periods of its breathing."""

SKIN = 0.08
"""Neighbour skin in grain diameters."""

DRAG_COEFFICIENT = 10.0
"""C_d expected in the simulations (Guillard et al. 2014, Fig. 8a)."""

BULK_FRICTION = 0.36
"""Friction of a sheared bed of frictional spheres, tan 20 degrees."""

FRONT_STRESS = 15.0
"""Stress in front of the cylinder over the confining pressure (Guillard et al. 2014, Fig. 11)."""

QUASI_STATIC = 0.02
"""Inertial number above which the forces, the lift first, depend on the speed."""

DEEPEST = 0.5
"""Overlap in grain diameters at which a grain is no grain any more."""

MAX_STEPS = 2_000_000_000

SPEED_HINT = 4e6
"""Grain-steps per second of one core, for the estimate of the cost."""


@dataclass(frozen=True, kw_only=True)
class TankNumerics(Numerics):
    """Every number that the deck needs and the scene does not say."""

    rayleigh_time: Value[float]
    hertz_time: Value[float]
    time_step: Value[float]
    settle_damping: Value[float]
    settle_energy: Value[float]
    settle_steps: Value[int]
    settle_steps_max: Value[int]
    drive_steps: Value[int]
    sample_every: Value[int]
    row_every: Value[int]
    snapshot_every: Value[int]
    surface_every: Value[int]
    trajectory_every: Value[int]
    progress_every: Value[int]
    look_every: Value[int]
    restart_every: Value[int]
    skin: Value[float]
    sort_every: Value[int]
    processors: Value[tuple[int, int, int]]
    overlap_ratio: Value[float]
    inertial_number: Value[float]
    grip: Value[float]
    grain_steps: Value[float]
    core_hours: Value[float]
    fields_every: Value[int] | None = None


def derive(scene: TankScene, ranks: int = 1, settled: bool = False) -> TankNumerics:
    """The numerics of `scene` on `ranks` processes, from a bed that was `settled` before or not.

    Raises CaseError when they cannot be.
    """
    rayleigh, impact = _rayleigh_time(scene), _hertz_time(scene)
    step = _time_step(scene, rayleigh, impact)
    dt = step.value
    settle = _resettling(scene, dt) if settled else _settling(scene, dt)
    drive = _drive_steps(scene, dt)
    sample = _sample_every(scene, impact.value, dt)
    row = _row_every(scene, sample.value, dt)
    grid = _processors(scene, ranks)
    overlap, inertial, grip = _overlap_ratio(scene), _inertial_number(scene), _grip(scene)
    cost = _grain_steps(scene, settle[1].value + drive.value)
    return TankNumerics(
        rayleigh_time=rayleigh,
        hertz_time=impact,
        time_step=step,
        settle_damping=settle[0],
        settle_energy=_settle_energy(scene),
        settle_steps=settle[1],
        settle_steps_max=settle[2],
        drive_steps=drive,
        sample_every=sample,
        row_every=row,
        snapshot_every=_snapshot_every(scene, drive.value),
        surface_every=_surface_every(scene, row.value, dt),
        trajectory_every=_trajectory_every(scene, dt),
        progress_every=Value(
            max(drive.value // 200, 1), "steps", "the log shows progress 200 times a run"
        ),
        look_every=Value(50, "steps", "a settling bed is looked at often enough to end early"),
        restart_every=restart_every(
            scene.numerics.restart_every,
            _grains(scene),
            SPEED_HINT * ranks / _grains(scene),
            row.value,
            "rows",
        ),
        skin=_skin(scene),
        sort_every=Value(1000, "steps", "a bed moves as a block: its order in memory lasts"),
        processors=grid,
        overlap_ratio=overlap,
        inertial_number=inertial,
        grip=grip,
        grain_steps=cost,
        core_hours=Value(
            cost.value / SPEED_HINT / 3600.0,
            "h",
            f"at {SPEED_HINT:.0e} grain-steps per second on one core",
        ),
        fields_every=_fields_every(scene, drive.value),
        warnings=tuple(_warnings(scene, dt, rayleigh.value, impact.value, overlap, inertial, grip)),
    )


def pressure(scene: TankScene) -> float:
    """Expected pressure (Pa) in the bed at the cylinder's axis, of grains and lid."""
    density = _bulk_density(scene)
    weight = density * scene.intruder.depth * scene.bulk_gravity
    return weight + density * _lid_depth(scene) * GRAVITY


def _bulk_density(scene: TankScene) -> float:
    return SETTLED_FRACTION * scene.grains.density


def _lid_depth(scene: TankScene) -> float:
    if scene.lid is None:
        return 0.0
    ratio_to_bulk = scene.lid.density_ratio / SETTLED_FRACTION
    return granular.lid_depth(scene.grains.diameter, ratio_to_bulk)


def _rayleigh_time(scene: TankScene) -> Value[float]:
    g = scene.grains
    time = hertz.rayleigh_time(g.diameter, g.density, g.youngs_modulus, g.poisson_ratio)
    return Value(time, "s", "a Rayleigh wave's way around a grain")


def impact_speed(scene: TankScene) -> float:
    """Speed (m/s) at which grains are expected to meet: that of the drive, or of a fall of d."""
    return max(scene.drive.speed, sqrt(2.0 * GRAVITY * scene.grains.diameter))


def _hertz_time(scene: TankScene) -> Value[float]:
    grains, speed = scene.grains, impact_speed(scene)
    time = hertz.hertz_time(grains.stiffness, grains.mass / 2.0, speed)
    return Value(time, "s", f"an impact of two grains at {speed:.3g} m/s, the drive or a fall of d")


def _time_step(scene: TankScene, rayleigh: Value[float], impact: Value[float]) -> Value[float]:
    smaller = min(rayleigh.value, impact.value)
    chosen = scene.numerics.time_step
    if chosen is not None:
        if chosen > smaller:
            raise CaseError(
                "numerics.time_step",
                chosen,
                "no contact survives a step above its own time scale",
                f"choose at most {smaller:.3g} s; {STEP_FRACTION * smaller:.3g} s is derived",
            )
        return Value(chosen, "s", f"set by hand: {chosen / smaller:.3f} of the smaller time")
    step = float(f"{STEP_FRACTION * smaller:.3g}")
    return Value(step, "s", f"{STEP_FRACTION} of the smaller of the Rayleigh and Hertz times")


def _settling(scene: TankScene, dt: float) -> tuple[Value[float], Value[int], Value[int]]:
    """Damping coefficient, least and most steps of the settling stage."""
    rate = _breathing_rate(scene)
    damping = Value(
        scene.grains.mass * rate, "kg/s", f"the bed breathes at about {rate:.3g} rad/s: damp that"
    )
    by_hand = scene.numerics.settle_time is not None
    least = settle_time(scene)
    reason = "set by hand" if by_hand else "one period of the bed's breathing at least"
    most = max(40.0 * pi / rate, 3.0 * least)
    return (
        damping,
        Value(_steps("numerics.settle_time", least, least, dt), "steps", reason),
        Value(
            _steps("numerics.settle_time", least, most, dt),
            "steps",
            "20 periods: a bed that still moves then is refused",
        ),
    )


def settle_time(scene: TankScene) -> float:
    """How long (s) a packed bed settles at least."""
    chosen = scene.numerics.settle_time
    return chosen if chosen is not None else 2.0 * pi / _breathing_rate(scene)


def _resettling(scene: TankScene, dt: float) -> tuple[Value[float], Value[int], Value[int]]:
    """The same for a bed that was settled before and only loads its tangential springs anew."""
    rate = _breathing_rate(scene)
    return (
        Value(
            SPRING_DAMPING * scene.grains.mass * rate,
            "kg/s",
            f"{SPRING_DAMPING:g} times what damps the bed's breathing: it was settled before",
        ),
        Value(
            ceil(SPRING_TIME * 2.0 * pi / rate / dt),
            "steps",
            f"{SPRING_TIME:g} periods of the bed's breathing: contacts load their springs",
        ),
        Value(ceil(40.0 * pi / rate / dt), "steps", "20 periods: it is refused then"),
    )


def _breathing_rate(scene: TankScene) -> float:
    """Rate (rad/s) of the bed's slowest vertical wave: sqrt(load / (mass x sag))."""
    grains, height = scene.grains, scene.tank.height
    bed, lid = _bulk_density(scene) * height, _bulk_density(scene) * _lid_depth(scene)
    load = bed * scene.bulk_gravity + lid * GRAVITY
    force = (load - 0.5 * bed * scene.bulk_gravity) * grains.diameter**2
    sag = hertz.static_overlap(force, grains.stiffness) / grains.diameter * height
    return sqrt(load / ((bed + lid) * sag))


def _settle_energy(scene: TankScene) -> Value[float]:
    energy = SETTLED * scene.grains.mass * GRAVITY * scene.grains.diameter
    speed = sqrt(2.0 * energy / scene.grains.mass)
    return Value(
        energy,
        "J",
        f"{SETTLED:g} m g d per grain, a speed of {speed / scene.drive.speed:.2g} U0: at rest",
    )


def _drive_steps(scene: TankScene, dt: float) -> Value[int]:
    time = scene.drive.distance / scene.drive.speed
    steps = _steps("drive.distance", scene.drive.distance, time, dt)
    return Value(steps, "steps", "distance over speed over time step")


def _steps(key: str, value: float, time: float, dt: float) -> int:
    """Steps of a duration (s); CaseError names the key behind it when they are too many."""
    if time / dt > MAX_STEPS:
        raise CaseError(
            key,
            value,
            f"this takes {time / dt:.3g} steps of {dt:.3g} s",
            f"keep it under {MAX_STEPS:.0e} steps",
        )
    return ceil(time / dt)


def _sample_every(scene: TankScene, impact: float, dt: float) -> Value[int]:
    chosen = scene.numerics.sample_every
    if chosen is not None:
        return Value(chosen, "steps", "set by hand")
    return Value(max(int(impact / (2.0 * dt)), 1), "steps", "two samples in the shortest contact")


def _row_every(scene: TankScene, sample: int, dt: float) -> Value[int]:
    target = 0.05 * scene.grains.diameter / (scene.drive.speed * dt)
    return Value(
        sample * max(round(target / sample), 1),
        "steps",
        "forces are averaged over 1/20 d of displacement, far less than they stay correlated",
    )


def _snapshot_every(scene: TankScene, drive_steps: int) -> Value[int]:
    diameters = scene.drive.distance / scene.intruder.diameter
    count = min(max(ceil(diameters / 4.0), 2), 6)
    return Value(drive_steps // count, "steps", f"{count} snapshots of the bed, for pictures")


def _surface_every(scene: TankScene, row: int, dt: float) -> Value[int]:
    steps = 0.1 * scene.intruder.diameter / (scene.drive.speed * dt)
    return Value(row * max(round(steps / row), 1), "steps", "far surface every 1/10 D: its depth")


def _trajectory_every(scene: TankScene, dt: float) -> Value[int]:
    steps = 0.2 * scene.intruder.diameter / (scene.drive.speed * dt)
    return Value(max(round(steps), 1), "steps", "with --dump, a frame every 1/5 D to look at")


def _fields_every(scene: TankScene, drive_steps: int) -> Value[int] | None:
    if scene.fields is None:
        return None
    transient = TRANSIENT * scene.intruder.diameter / scene.drive.distance
    steps = int((1.0 - transient) * drive_steps / scene.fields.snapshots)
    reason = f"{scene.fields.snapshots} times after the first {TRANSIENT:g} D: grains and contacts"
    return Value(max(steps, 1), "steps", reason)


def _skin(scene: TankScene) -> Value[float]:
    chosen = scene.numerics.skin
    if chosen is not None:
        if chosen > scene.grains.diameter:
            raise CaseError(
                "numerics.skin",
                chosen,
                "a neighbour skin wider than a grain only costs time",
                f"choose at most {scene.grains.diameter:.3g} m; {SKIN} d is derived",
            )
        return Value(chosen, "m", "set by hand")
    return Value(
        float(f"{SKIN * scene.grains.diameter:.3g}"),
        "m",
        f"{SKIN} d: the least time in pairs and lists together, measured",
    )


def _processors(scene: TankScene, ranks: int) -> Value[tuple[int, int, int]]:
    length, thickness = scene.tank.length, scene.tank.thickness
    grids = [(x, ranks // x, 1) for x in range(1, ranks + 1) if ranks % x == 0]
    best = min(grids, key=lambda g: (g[0] * thickness + g[1] * length, -g[0]))
    return Value(best, "ranks", "least surface between ranks; the free height is never split")


def _overlap_ratio(scene: TankScene) -> Value[float]:
    force = FRONT_STRESS * pressure(scene) * scene.grains.diameter**2
    overlap = hertz.static_overlap(force, scene.grains.stiffness) / scene.grains.diameter
    if overlap > DEEPEST:
        raise CaseError(
            "grains.youngs_modulus",
            scene.grains.youngs_modulus,
            f"the grains in front of the cylinder would overlap by {overlap:.2g} d",
            f"make it at least {scene.grains.youngs_modulus * (overlap / 0.05) ** 1.5:.2g} Pa",
        )
    return Value(overlap, "d", f"in front of the cylinder, at {FRONT_STRESS:g} times the pressure")


def _inertial_number(scene: TankScene) -> Value[float]:
    rate = scene.drive.speed / scene.intruder.diameter
    number = granular.inertial_number(
        rate, scene.grains.diameter, pressure(scene), scene.grains.density
    )
    return Value(number, "1", "(U0/D) d / sqrt(P/rho_g), P the pressure at the axis")


def _grip(scene: TankScene) -> Value[float]:
    lid, height = _lid_depth(scene), scene.tank.height
    bed = height if scene.bulk_gravity else 0.0
    depth = pressure(scene) / (_bulk_density(scene) * GRAVITY)
    share = granular.grip(
        DRAG_COEFFICIENT,
        depth,
        scene.intruder.diameter,
        BULK_FRICTION,
        (bed + 2.0 * lid) * scene.tank.length,
    )
    return Value(share, "1", "expected drag over the friction at the driven layers; 1 slips")


def _grain_steps(scene: TankScene, steps: int) -> Value[float]:
    return Value(_grains(scene) * steps, "1", "grains times steps")


def _grains(scene: TankScene) -> float:
    """Grains of the bed and of the driven layers."""
    layers = 1 if scene.lid is None else 2
    driven = layers * scene.tank.length * scene.tank.thickness / scene.grains.diameter**2
    return scene.grain_count + driven


def _warnings(
    scene: TankScene,
    dt: float,
    rayleigh: float,
    impact: float,
    overlap: Value[float],
    inertial: Value[float],
    grip: Value[float],
) -> Iterator[str]:
    d, box, drive = scene.grains.diameter, scene.tank, scene.drive
    if dt > STEP_BOUND * min(rayleigh, impact):
        yield (
            f"The time step set by hand, {dt:.3g} s, is above {STEP_BOUND} of the smaller of the "
            f"Rayleigh and Hertz times ({min(rayleigh, impact):.3g} s): contacts may gain energy."
        )
    if inertial.value > QUASI_STATIC:
        yield (
            f"Not quasi-static: the inertial number is {inertial.value:.2g}, above {QUASI_STATIC}; "
            "the forces, the lift first, depend on drive.speed."
        )
    if scene.lid is not None and scene.intruder.depth < (1.0 - 1e-9) * scene.lid_depth:
        yield (
            f"The lid is near: intruder.depth is {scene.intruder.depth:.4g} m, the paper's "
            f"{scene.lid_depth:.4g} m; the flow may feel it."
        )
    if box.thickness < 8.0 * d:
        yield (
            f"The box is thin: tank.thickness is {box.thickness / d:.3g} d, the paper's 10 d; "
            "a grain feels its periodic image."
        )
    if drive.distance > box.length:
        yield (
            f"The cylinder re-enters its own wake: drive.distance is {drive.distance:.4g} m, "
            f"tank.length {box.length:.4g} m."
        )
    elif drive.distance > scene.fresh_distance:
        yield (
            "The far field will hold grains that have passed the cylinder: drive.distance is "
            f"{drive.distance:.4g} m, and they arrive after {scene.fresh_distance:.4g} m."
        )
    if grip.value > 0.5:
        yield (
            f"The driven layers may slip: the expected drag is {grip.value:.2g} of the friction "
            "that they can pass on; lengthen the tank, and watch bed_speed_ratio."
        )
    if overlap.value > 0.05:
        yield (
            f"Soft grains: the expected overlap in front of the cylinder is {overlap.value:.2g} d, "
            "above 0.05; raise grains.youngs_modulus."
        )
