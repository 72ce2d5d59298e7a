"""Compiled: the equations of many climbs, whose coefficients are waves around the circle of Chebyshev polynomials.

ln S is sum_j T_j(x) (theta_j + alpha_j cos 2 phi + ...): in each sector a polynomial. Of a curvature with weights w the
element of two coefficients is sum_k w_k T_p(x_k) T_q(x_k) times what their waves are there, and as

    T_p T_q = (T_(p + q) + T_|p - q|) / 2

all elements follow from 2 Q - 1 moments of w a sector, where there are several hundred pairs of coefficients.
"""

import numpy as np
from numpy.typing import NDArray

from psflut.kernels import inlined
from psflut.kernels.algebra import solve
from psflut.kernels.lanes import Model, Room

Floats = NDArray[np.float64]


@inlined
def spread(n: int, terms: Floats, model: Model, room: Room) -> None:
    """What coefficients of n lanes make of ln S in every annulus of every sector."""
    for s in range(len(model.waves)):
        for i in range(n):
            turned = room.turned[s, i]
            for j in range(len(turned)):
                turned[j] = terms[i, j]
            for w in range(1, model.waves.shape[1]):
                first, part = model.first[w], model.waves[s, w]
                if part != 0.0:
                    for j in range(first, model.first[w + 1]):
                        turned[j - first] += part * terms[i, j]
        np.dot(room.turned[s, :n], model.basis[s], room.annuli[0, s, :n])


@inlined
def gathered(n: int, model: Model, room: Room) -> None:
    """The slope by the coefficients of n lanes, in the room's `right`, from that by ln S in every annulus."""
    for s in range(len(model.waves)):
        np.dot(room.annuli[1, s, :n], model.functions[s], room.turned[s, :n])
    for w in range(model.waves.shape[1]):
        first = model.first[w]
        for j in range(first, model.first[w + 1]):
            for i in range(n):
                slope = 0.0
                for s in range(len(model.waves)):
                    slope += model.waves[s, w] * room.turned[s, i, j - first]
                room.right[j, i] = slope


@inlined
def solved(n: int, model: Model, room: Room) -> None:
    """Solve for what is `right` in the room with the curvature of n lanes, of the weights in the third of `annuli`."""
    (sectors, waves), moments = model.waves.shape, model.moments.shape[1]
    for s in range(sectors):
        np.dot(model.moments[s], room.annuli[2, s, :n].T, room.told[s, : moments * n].reshape(moments, n))
    for v in range(waves):
        for w in range(v, waves):
            _together(n, v, w, model, room)
            _curved(n, v, w, model, room)
    solve(n, room.packed, room.right, room.value[1], room.value[2:])


@inlined
def _together(n: int, v: int, w: int, model: Model, room: Room) -> None:
    """Half the moments of the weights times two waves, of the orders that their coefficients need."""
    first = model.first
    for q in range(first[v + 1] - first[v] + first[w + 1] - first[w] - 1):
        for i in range(n):
            room.both[q, i] = 0.0
        for s in range(len(model.waves)):
            share, told = 0.5 * model.waves[s, v] * model.waves[s, w], room.told[s, q * n : q * n + n]
            if share != 0.0:
                for i in range(n):
                    room.both[q, i] += share * told[i]


@inlined
def _curved(n: int, v: int, w: int, model: Model, room: Room) -> None:
    """The curvature's elements of the coefficients of two waves."""
    first, count = model.first, len(model.mean)
    for j in range(first[v], first[v + 1]):
        row = j * count - j * (j + 1) // 2
        for k in range(max(j, first[w]), first[w + 1]):
            p, q, prior = j - first[v], k - first[w], model.packed[row + k]
            more, less, element = room.both[p + q], room.both[abs(p - q)], room.packed[row + k]
            for i in range(n):
                element[i] = prior + more[i] + less[i]
