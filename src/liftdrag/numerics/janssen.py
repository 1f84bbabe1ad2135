"""The numerics of a Janssen piston, derived from its scene alone, each value with its reason."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, inf, pi, sqrt

from liftdrag import granular, hertz
from liftdrag.errors import CaseError, at_least, at_most
from liftdrag.granular import GRAVITY
from liftdrag.numerics.restarts import restart_every
from liftdrag.numerics.value import Numerics, Value
from liftdrag.scene import JanssenScene

LEAST_RATIO, MOST_RATIO = 0.4, 1.2
"""Bounds on Janssen's K, horizontal over vertical stress, for the largest load expected."""

MEAN_FORCE = 0.9
"""Mean contact force over sigma d^2 at six contacts a grain and a solid fraction of 0.6."""

STRONGEST = 5.0
"""The strongest contact force over the mean."""

OVERLAP_BOUND = 1e-3
"""Overlap of the strongest contact, over d, from which a stiffness is derived."""

DEEPEST = 0.2
"""The same at which a grain is no grain any more."""

MOST_BINS = 1e7

BINS_PER_GRAIN = 100.0

MOST_GROWTH = 12.0
"""Exponent of Janssen's growth, upward, that is still computed."""

FEW_GRAINS = 500
"""Grains of a rank below which it waits for the others more than it computes."""

SOFT = 0.01
"""The same above which grains are soft."""

STEPS_PER_CONTACT = 25.0
"""Time steps in the shortest contact."""

FEWEST_STEPS = 8.0
"""Time steps in the shortest contact below which a step set by hand is refused."""

HERTZ_FRACTION = 0.15
"""Time step over the smaller of the Rayleigh and Hertz times."""

DAMPING = 1.0
"""Rate at which a settling layer is slowed, over sqrt(g/d)."""

RELAXED = 2.0
"""Time in which a layer's impact is over, after its fall, over sqrt(d/g)."""

GAP = 1.5
"""Fall of a new layer, in d."""

COMPACTION = 0.08
"""How much lower a settled layer is than as packed, of its height."""

MOBILISE_FIRST = 3.0
"""Way of the wall, in d, after which a column has forgotten how it was packed.

The wall's friction is at its limit, or grains roll, after 0.1 d; but in the mean of 24 columns of
8 d the load then rose by 17 % more, over about 3 d.
"""

MOBILISE_NEXT = 0.3
"""The same after a layer was added to a column that has: only the layer has to forget."""

ROWS, BLOCKS = 200, 20
"""Rows of samples in an average, and blocks of them that a profile is averaged over."""

PROFILES = 5
"""Profiles taken in a block."""

QUASI_STATIC = 0.1
"""Inertial number above which the friction depends on the speed."""

SKIN = 0.15
"""Neighbour skin in grain diameters."""

SPEED_HINT = 4e6
"""Grain-steps per second of one core, for the estimate of the cost."""

MOST_STEPS = 2_000_000_000


@dataclass(frozen=True)
class Level:
    """One fill: `count` grains, and the steps at which its layer is added, has settled, the wall
    is mobilised, and the average ends."""

    count: int
    start: int
    settled: int
    mobilised: int
    end: int


@dataclass(frozen=True, kw_only=True)
class JanssenNumerics(Numerics):
    """Every number that the deck needs and the scene does not say.

    `stiffness` is in N/m, for Hertz a modulus in Pa.
    """

    levels: tuple[Level, ...]
    largest_stress: Value[float]
    stiffness: Value[float]
    overlap_ratio: Value[float]
    contact_time: Value[float]
    time_step: Value[float]
    settle_rate: Value[float]
    settle_first: Value[int]
    settle_next: Value[int]
    mobilise_first: Value[int]
    mobilise_next: Value[int]
    average_steps: Value[int]
    sample_every: Value[int]
    row_every: Value[int]
    profile_every: Value[int]
    block_every: Value[int]
    progress_every: Value[int]
    restart_every: Value[int]
    bin_height: Value[float]
    bins: Value[int]
    skin: Value[float]
    processors: Value[tuple[int, int, int]]
    inertial_number: Value[float]
    grain_steps: Value[float]
    core_hours: Value[float]


def derive(scene: JanssenScene, ranks: int = 1) -> JanssenNumerics:
    """The numerics of `scene` on `ranks` processes. Raises CaseError when they cannot be."""
    _check_emptiness(scene)
    stress = _largest_stress(scene)
    stiffness = _stiffness(scene, stress.value)
    overlap = _overlap_ratio(scene, stress.value, stiffness.value)
    contact = _contact_time(scene, stiffness.value)
    step, sample, row = _time_step(scene, contact.value)
    dt, block = step.value, row * ROWS // BLOCKS
    phases = _phases(scene, dt, block)
    levels = _levels(scene, phases, ROWS * row)
    inertial = _inertial_number(scene)
    cost = float(sum(level.count * (level.end - level.start) for level in levels))
    height = 2.0 * scene.grains.diameter
    return JanssenNumerics(
        levels=levels,
        largest_stress=stress,
        stiffness=stiffness,
        overlap_ratio=overlap,
        contact_time=contact,
        time_step=step,
        settle_rate=_settle_rate(scene),
        settle_first=phases[0],
        settle_next=phases[1],
        mobilise_first=phases[2],
        mobilise_next=phases[3],
        average_steps=Value(ROWS * row, "steps", f"{ROWS} rows; drive.distance, or duration"),
        sample_every=Value(sample, "steps", "at least twice in the shortest contact"),
        row_every=Value(row, "steps", f"a row of means, {ROWS} in an average"),
        profile_every=Value(block // PROFILES, "steps", f"{PROFILES} profiles in a block"),
        block_every=Value(block, "steps", f"profiles averaged, {BLOCKS} blocks in an average"),
        progress_every=Value(block, "steps", "the log shows progress once a block"),
        restart_every=restart_every(
            scene.numerics.restart_every,
            scene.grain_count,
            SPEED_HINT * ranks / scene.grain_count,
            block,
            "blocks",
        ),
        bin_height=Value(height, "m", "2 d, of the profiles"),
        bins=Value(ceil(_highest(scene) / height), "1", "bins of the profiles to the top"),
        skin=_skin(scene),
        processors=_processors(ranks),
        inertial_number=inertial,
        grain_steps=Value(cost, "1", "grains times steps, over all fills"),
        core_hours=Value(
            cost / SPEED_HINT / 3600.0, "h", f"at {SPEED_HINT:.0e} grain-steps per second"
        ),
        warnings=tuple(_warnings(scene, ranks, step.value, contact.value, overlap, inertial)),
    )


def _largest_stress(scene: JanssenScene) -> Value[float]:
    """The largest vertical stress by Janssen's equation, K the worst of its bounds."""
    upward = scene.drive.motion == "piston up"
    ratio = MOST_RATIO if upward else LEAST_RATIO
    depth = scene.height_of(scene.grain_count)
    weight = scene.bulk_density * GRAVITY
    top = scene.lid_mass * GRAVITY / scene.tube.section
    beta = 4.0 * scene.tube.friction * ratio / scene.tube.diameter * (-1.0 if upward else 1.0)
    _check_growth(scene, -beta * depth)
    bottom = granular.janssen_stress(depth, weight, beta, top)
    return Value(max(top, bottom), "Pa", f"Janssen's, at K = {ratio} and the last fill")


def _check_emptiness(scene: JanssenScene) -> None:
    """An engine sorts grains into bins of half a grain; a huge, mostly empty box stalls it."""
    across = 2.0 * scene.tube.diameter / scene.grains.diameter
    bins = across**2 * 2.0 * _highest(scene) / scene.grains.diameter
    if bins > MOST_BINS + BINS_PER_GRAIN * scene.grain_count:
        raise CaseError(
            "tube.diameter",
            scene.tube.diameter,
            f"{scene.grain_count} grains in a tube so wide are mostly empty space, of {bins:.2g} "
            "bins of half a grain",
            "make the tube narrower, or fill in more",
        )


def _check_growth(scene: JanssenScene, exponent: float) -> None:
    if exponent > MOST_GROWTH:
        key = "fill.mass" if scene.fill.mass is not None else "fill.height"
        raise CaseError(
            key,
            getattr(scene.fill, key.partition(".")[2]),
            f"pushed up, the load may grow by exp({exponent:.3g})",
            f"fill at most {MOST_GROWTH / exponent:.2g} of it",
        )


def _strongest(scene: JanssenScene, stress: float) -> float:
    return STRONGEST * MEAN_FORCE * stress * scene.grains.diameter**2


def _stiffness(scene: JanssenScene, stress: float) -> Value[float]:
    grains = scene.grains
    unit = "Pa" if grains.contact == "hertz" else "N/m"
    given = grains.youngs_modulus if grains.contact == "hertz" else grains.stiffness
    if given is not None:
        return Value(given, unit, "set by hand")
    bound = scene.numerics.overlap_bound or OVERLAP_BOUND
    depth, force = bound * grains.diameter, _strongest(scene, stress)
    value = force / depth
    if grains.contact == "hertz":
        value = force / (grains.hertz_stiffness(1.0) * depth**1.5)
    reason = f"overlaps of {bound:g} d at {STRONGEST:g} times the mean force"
    return Value(float(f"{value:.3g}"), unit, reason)


def _overlap_ratio(scene: JanssenScene, stress: float, stiffness: float) -> Value[float]:
    grains, force = scene.grains, _strongest(scene, stress)
    depth = force / stiffness
    if grains.contact == "hertz":
        depth = hertz.static_overlap(force, grains.hertz_stiffness(stiffness))
    ratio = depth / grains.diameter
    if ratio > DEEPEST:
        name = "youngs_modulus" if grains.contact == "hertz" else "stiffness"
        raise CaseError(
            f"grains.{name}",
            stiffness,
            f"the strongest contacts would overlap by {ratio:.2g} d",
            "leave it out: one that lets them overlap by 0.001 d is derived",
        )
    return Value(ratio, "d", f"at {STRONGEST:g} times the mean force")


def _contact_time(scene: JanssenScene, stiffness: float) -> Value[float]:
    grains = scene.grains
    if grains.contact == "hertz":
        speed = max(scene.drive.speed or 0.0, sqrt(2.0 * GRAVITY * GAP * grains.diameter))
        reduced = hertz.hertz_time(grains.hertz_stiffness(stiffness), grains.mass / 2.0, speed)
        nu = grains.poisson_ratio or 0.0
        wave = hertz.rayleigh_time(grains.diameter, grains.density, stiffness, nu)
        return Value(min(reduced, wave), "s", f"the Rayleigh or the Hertz time at {speed:.2g} m/s")
    steepest = stiffness
    if grains.contact == "walton-braun":
        steepest /= grains.restitution**2
    reason = "half a swing of two grains on the spring"
    if grains.contact == "walton-braun":
        reason += " in unloading, K2 = K1/e^2"
    return Value(pi * sqrt(grains.mass / (2.0 * steepest)), "s", reason)


def _time_step(scene: JanssenScene, contact: float) -> tuple[Value[float], int, int]:
    """The time step, so that whole rows fill an average; the steps of a sample and of a row."""
    is_hertz = scene.grains.contact == "hertz"
    share = HERTZ_FRACTION if is_hertz else 1.0 / STEPS_PER_CONTACT
    chosen = scene.numerics.time_step
    bound = contact if is_hertz else contact / FEWEST_STEPS
    if chosen is not None and chosen > bound:
        raise CaseError(
            "numerics.time_step",
            chosen,
            f"the shortest contact, {contact:.3g} s, has too few steps of this",
            f"choose at most {at_most(bound)} s; {share * contact:.3g} s is derived",
        )
    largest = share * contact if chosen is None else chosen
    duration = _duration(scene)
    if chosen is None and duration < 2.0 * largest:
        key = "drive.duration" if scene.drive.duration is not None else "drive.distance"
        given = getattr(scene.drive, key.partition(".")[2])
        raise CaseError(
            key,
            given,
            f"this is an average over less than two time steps of {largest:.3g} s",
            f"make it at least {at_least(2.0 * largest / duration * given)} in SI units",
        )
    least = ceil(duration / (ROWS * largest) * (1.0 - 1e-9))
    samples = ceil(least / max(int(0.5 * contact / largest), 1))
    sample = ceil(least / samples)
    row = samples * sample
    step = duration / (ROWS * row)
    key = "drive.duration" if scene.drive.duration is not None else "drive.distance"
    _check_steps(scene, ROWS * row, key if chosen is None else "numerics.time_step")
    reason = f"at most {share:.3g} of the contact time" if chosen is None else "set by hand"
    return Value(step, "s", f"{reason}; less to end with a row"), sample, row


def _duration(scene: JanssenScene) -> float:
    """Time (s) of an average."""
    drive = scene.drive
    if drive.duration is not None:
        return drive.duration
    return (drive.distance or 0.0) / (drive.speed or inf)


def _check_steps(scene: JanssenScene, steps: int, key: str) -> None:
    if steps * len(scene.counts) > MOST_STEPS:
        table, _, name = key.partition(".")
        raise CaseError(
            key,
            getattr(getattr(scene, table), name),
            f"this takes {steps * len(scene.counts):.3g} steps over all fills",
            f"keep it under {MOST_STEPS:.0e}; a step is shorter where contacts are stiffer",
        )


def _settle_rate(scene: JanssenScene) -> Value[float]:
    rate = DAMPING * sqrt(GRAVITY / scene.grains.diameter)
    return Value(rate, "1/s", "sqrt(g/d), at which the motion of a settling layer is slowed")


def _phases(
    scene: JanssenScene, dt: float, block: int
) -> tuple[Value[int], Value[int], Value[int], Value[int]]:
    """Steps to settle and to mobilise, at first and after; whole blocks of steps."""

    def whole(time: float, key: str) -> int:
        steps = ceil(time / (block * dt) * (1.0 - 1e-9)) * block
        _check_steps(scene, steps, key)
        return steps

    counts, chosen = scene.counts, scene.numerics.settle_time
    first = chosen or _settle_time(scene, counts[0])
    after = chosen or _settle_time(scene, counts[-1] - counts[-2] if len(counts) > 1 else 1)
    why = "set by hand" if chosen else "a fall, and a while to come to rest"
    ways = (_way(scene, MOBILISE_FIRST), _way(scene, MOBILISE_NEXT))
    times = [way / scene.drive.speed if scene.drive.speed else 0.0 for way in ways]
    by_hand = "set by hand" if scene.drive.mobilise else "until the packing is forgotten"
    return (
        Value(whole(first, "numerics.settle_time"), "steps", why),
        Value(whole(after, "numerics.settle_time"), "steps", f"{why}, of a layer added"),
        Value(whole(times[0], "drive.mobilise"), "steps", by_hand),
        Value(whole(times[1], "drive.mobilise"), "steps", f"{by_hand}, after a layer was added"),
    )


def _settle_time(scene: JanssenScene, count: int) -> float:
    d = scene.grains.diameter
    fall = COMPACTION * scene.height_of(count) + GAP * d
    return 1.5 * sqrt(2.0 * fall / GRAVITY) + RELAXED * sqrt(d / GRAVITY)


def _way(scene: JanssenScene, diameters: float) -> float:
    return scene.drive.mobilise or diameters * scene.grains.diameter


def _levels(
    scene: JanssenScene,
    phases: tuple[Value[int], Value[int], Value[int], Value[int]],
    average: int,
) -> tuple[Level, ...]:
    levels, now = list[Level](), 0
    for k, count in enumerate(scene.counts):
        settle, mobilise = (phases[1], phases[3]) if k else (phases[0], phases[2])
        settled = now + settle.value
        mobilised = settled + mobilise.value
        levels.append(Level(count, now, settled, mobilised, mobilised + average))
        now = mobilised + average
    return tuple(levels)


def _highest(scene: JanssenScene) -> float:
    """Height (m) that no grain of a settled column is above."""
    return scene.height_of(scene.grain_count, 0.9) + 3.0 * scene.grains.diameter


def _skin(scene: JanssenScene) -> Value[float]:
    chosen, d = scene.numerics.skin, scene.grains.diameter
    if chosen is None:
        return Value(SKIN * d, "m", f"{SKIN} d: the least time in pairs and lists together")
    if chosen > d:
        raise CaseError(
            "numerics.skin",
            chosen,
            "a neighbour skin wider than a grain only costs time",
            f"choose at most {at_most(d)} m; {SKIN} d is derived",
        )
    return Value(chosen, "m", "set by hand")


def _processors(ranks: int) -> Value[tuple[int, int, int]]:
    x = max(n for n in range(1, int(sqrt(ranks)) + 1) if ranks % n == 0)
    return Value((ranks // x, x, 1), "ranks", "across the tube: its height fills up")


def _inertial_number(scene: JanssenScene) -> Value[float]:
    weight = scene.bulk_density * GRAVITY
    deepest = scene.height_of(scene.grain_count) / 2.0
    if scene.tube.friction:
        deepest = min(deepest, scene.tube.diameter / (4.0 * scene.tube.friction))
    pressure = weight * deepest + scene.lid_mass * GRAVITY / scene.tube.section
    rate = (scene.drive.speed or 0.0) / scene.grains.diameter
    number = granular.inertial_number(rate, scene.grains.diameter, pressure, scene.grains.density)
    return Value(number, "1", "(v/d) d / sqrt(P/rho_g), P what the wall bears")


def _warnings(
    scene: JanssenScene,
    ranks: int,
    dt: float,
    contact: float,
    overlap: Value[float],
    inertial: Value[float],
) -> Iterator[str]:
    if inertial.value > QUASI_STATIC:
        yield (
            f"Not quasi-static: the inertial number is {inertial.value:.2g}, above {QUASI_STATIC}; "
            "the friction of the wall depends on drive.speed."
        )
    if overlap.value > SOFT:
        yield (
            f"Soft grains: the expected overlap of the strongest contacts is {overlap.value:.2g} "
            f"d, above {SOFT}; raise grains.stiffness (or youngs_modulus)."
        )
    if ranks > 1 and scene.grain_count < FEW_GRAINS * ranks:
        yield (
            f"Few grains to share: {scene.grain_count} on {ranks} ranks, and {FEW_GRAINS} each are "
            "the least that gain; use fewer --ranks."
        )
    usual = HERTZ_FRACTION * contact
    if scene.grains.contact != "hertz":
        usual = contact / STEPS_PER_CONTACT
    if dt > 1.5 * usual:
        yield (
            f"The time step set by hand, {dt:.3g} s, is {dt / usual:.2g} times the one derived: "
            "contacts may gain energy."
        )
