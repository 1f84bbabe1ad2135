"""The loop over the steps, and what is summed on the way.

The pairs are in BLOCKS ranges of grains, each with forces of its own, which are summed in order:
two threads or more all give the same bits.
"""

from __future__ import annotations

from math import isfinite

import numpy as np
from numba import prange

from liftdrag.dem.compiled import compiled
from liftdrag.dem.cylinders.candidates import Candidates, candidates, largest_bound
from liftdrag.dem.cylinders.forces import DEEPEST, ELASTIC, TALLIES, pair_forces
from liftdrag.dem.cylinders.images import images, wrap
from liftdrag.dem.cylinders.motion import KINETIC, add_kinetic, drift, settle
from liftdrag.dem.cylinders.neighbours import Pairs, neighbours, no_pairs

BLOCKS = 4
"""Ranges of grains: as many threads have work."""

WIDE = 4.0
"""Skin of the candidates over that of the near pairs, which are chosen anew from them meanwhile."""

FINE, TOO_DEEP, NOT_FINITE = 0, 1, 2


@compiled()
def blocks_of(first, last):
    """Edges of the ranges of grains (BLOCKS + 1,) with equal numbers of near pairs."""
    n, p, before, edges = len(last), 0, 0, np.empty(BLOCKS + 1, np.int64)
    whole = (last - first).sum()
    for b in range(BLOCKS):
        while p < n and BLOCKS * before < b * whole:
            before += last[p] - first[p]
            p += 1
        edges[b] = p
    edges[BLOCKS] = n
    return edges


@compiled()
def add_up(tallies, sums, total, mean, kinetic):
    """Sum what the blocks have summed into `total`, and that and the kinetic sums into means.

    Empties the blocks. The largest depth is the largest, and in the mean the largest of all.
    """
    for t in range(TALLIES):
        total[t] = 0.0
        for b in range(BLOCKS):
            if t == DEEPEST:
                total[t] = max(total[t], tallies[b, t])
            else:
                total[t] += tallies[b, t]
            tallies[b, t] = 0.0
        mean[t] = max(mean[t], total[t]) if t == DEEPEST else mean[t] + total[t]
    for t in range(KINETIC):
        now = 0.0
        for b in range(BLOCKS):
            now += sums[b, t]
            sums[b, t] = 0.0
        kinetic[0, t] = now
        kinetic[1, t] += now


@compiled()
def verdict(total, deepest):
    """Whether the grains are grains still: FINE, or why not."""
    if not isfinite(total[ELASTIC]):
        return NOT_FINITE
    return TOO_DEEP if total[DEEPEST] > deepest else FINE


def _advance(place, move, ease, size, rate, shift, law, time_step, steps, skin, deepest):
    """`steps` steps, which change place and move.

    Returns the sums over the steps of the contacts' tallies, the last of them, the kinetic ones
    (2, KINETIC) of the last step and summed, the shift, the lists made, FINE or why it stopped,
    and the steps done.
    """
    n, middle = len(place), 0.5 * size[1]
    force, fresh, tallies = np.zeros((n, 6)), np.zeros((BLOCKS, n, 6)), np.zeros((BLOCKS, TALLIES))
    sums, far, share = np.zeros((BLOCKS, KINETIC)), np.zeros(BLOCKS), np.zeros(BLOCKS + 1, np.int64)
    mean, total, kinetic = np.zeros(TALLIES), np.zeros(TALLIES), np.zeros((2, KINETIC))
    wide = min(WIDE * skin, size.min() - 2.0 * largest_bound(place))
    reach = 2.0 * largest_bound(place) + wide
    shift = wrap(place, move, size, rate, shift)
    possible = candidates(place, size, rate, shift, wide)
    pairs, edges, origin = no_pairs(possible), np.zeros(BLOCKS + 1, np.int64), place.copy()
    since, lists, spare, status, done, kick = 0, 0, wide, FINE, 0, 0.0
    moved = skin
    for b in range(BLOCKS):
        share[b + 1] = (b + 1) * n // BLOCKS
    for step in range(steps + 1):
        if step > 0:
            since += 1
            slide, farthest = rate * time_step * since, 0.0
            for b in prange(BLOCKS):
                far[b] = drift(
                    place,
                    move,
                    ease,
                    force,
                    origin,
                    time_step,
                    slide,
                    middle,
                    share[b],
                    share[b + 1],
                )
            for b in range(BLOCKS):
                farthest = far[b] if not far[b] <= farthest else farthest
            shift += rate * size[1] * time_step
            moved = 2.0 * farthest + abs(slide) * reach
            if not isfinite(moved):
                status = NOT_FINITE
                break
        if moved >= skin:
            if step > 0:
                spare -= moved
            if spare < skin:
                shift = wrap(place, move, size, rate, shift)
                possible, spare = candidates(place, size, rate, shift, wide), wide
                pairs = no_pairs(possible)
            some, listed, away = Candidates(*possible), Pairs(*pairs), images(size, rate, shift)
            for b in prange(BLOCKS):
                neighbours(place, ease, law, some, listed, away, skin, share[b], share[b + 1])
            edges, since, lists, moved = blocks_of(pairs.first, pairs.last), 0, lists + 1, 0.0
            origin[:] = place
        listed, away = Pairs(*pairs), images(size, rate, shift)
        for b in prange(BLOCKS):
            pair_forces(
                place, move, listed, away, law, edges[b], edges[b + 1], fresh[b], tallies[b]
            )
        for b in prange(BLOCKS):
            settle(place, move, ease, force, fresh, kick, share[b], share[b + 1])
            add_kinetic(place, move, ease, rate, middle, share[b], share[b + 1], sums[b])
        kick = 0.5 * time_step
        add_up(tallies, sums, total, mean, kinetic)
        if step == 0:
            mean[:], kinetic[:] = 0.0, 0.0
            continue
        done = step
        status = verdict(total, deepest)
        if status != FINE:
            break
    return mean, total, kinetic, shift, lists, status, done


advance_alone = compiled()(_advance)
"""`_advance` on one thread."""

advance_together = compiled(parallel=True)(_advance)
"""`_advance` on as many threads as numba is told, BLOCKS at most."""
