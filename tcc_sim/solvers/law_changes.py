"""Derivatives of the friction law by the slip speed and by its own numbers, along a series and at single speeds.

Its text runs on numbers that carry their derivatives (`compiling.changing`), so that none of them is written out.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any

from tcc_sim.compiling.changing import Causes, Changing
from tcc_sim.compiling.unrolled import exp, limited, row_of
from tcc_sim.model.friction import Stribeck
from tcc_sim.solvers.key_derivatives import DECAY, EXCESS_RATIO, LATER, SMOOTHING
from tcc_sim.solvers.series import (
    FRICTION_ORDER_MAXIMUM,
    LOAD,
    SLIP,
    added,
    exponential,
    hyperbolic,
    product,
)

FRICTION, OF_SLIP, OF_EXCESS, OF_DECAY, OF_SMOOTHING, OF_LATER = range(6)
"""Columns of `law`: Ts mubar, and its derivatives by v, c_1, a_1, sigma; the first of those by c_2, a_2, c_3, a_3."""
NUMBERS_OF_ALL = {OF_EXCESS: EXCESS_RATIO, OF_DECAY: DECAY, OF_SMOOTHING: SMOOTHING,
                  **{OF_LATER + j: number for j, number in enumerate(LATER)}}
COLUMNS_OF_PAIRS = (OF_EXCESS, OF_DECAY), (OF_LATER, OF_LATER + 1), (OF_LATER + 2, OF_LATER + 3)
"""Columns of amplitude and rate of each exponential."""
NARROW, WIDE = 8, 16
"""Columns of `law` without those of the later exponentials, and with them."""


def numbers_of(stribeck: Stribeck, width: int = WIDE) -> dict[int, int]:
    """Return the numbers of the law by their columns in a `law` of this width."""
    pairs = COLUMNS_OF_PAIRS[:min(len(stribeck or ()) // 2, 3 if width > NARROW else 1)]
    return {cause: NUMBERS_OF_ALL[cause] for cause in (OF_SMOOTHING, *chain(*pairs))}


def mubar_at(v: Any, side: Any, sigma: Any, stribeck: Any) -> Changing:
    """Return mubar of (7) at a slip speed v, or at a row of them, on one side of v = 0, with its derivatives by v and
    by the numbers of the law, in the columns of `law`.
    """
    size = Changing(v, Causes({OF_SLIP: 1.0})) * side
    angle = size * Changing(sigma, Causes({OF_SMOOTHING: 1.0}))
    left = exp(-2.0 * angle.value)
    tanh, ratio = (1.0 - left) / (1.0 + left), Changing(1.0)
    for j, (of_share, of_rate) in zip(range(0, len(stribeck or ()), 2), COLUMNS_OF_PAIRS):
        exponent = -size * Changing(stribeck[j + 1], Causes({of_rate: 1.0}))
        factor = exp(limited(exponent.value, -700.0, 1.0))
        ratio = ratio + Changing(stribeck[j], Causes({of_share: 1.0})) * Changing(factor, exponent.change * factor)
    mubar: Changing = ratio * Changing(tanh, angle.change * (1.0 - tanh * tanh)) * side
    return mubar


class Exponential:
    """Series of F = exp(rate v), which starts with `factor`, with its derivatives dF = F d(rate v)."""

    def __init__(self, factor: Any, share: Changing, rate: Changing) -> None:
        self.share, self.rate, self._factors, self._bent = share, rate, [factor], list[Any]()

    def following(self, v: Changing, weighted: list[Any], k: int) -> Changing:
        """Return coefficient k, from that of v and from k v_k at the end of `weighted`."""
        if k > 0:
            exponential(self.rate.value, weighted, self._factors, k)
        self._bent.append((v * self.rate).change)
        return Changing(self._factors[k], product(self._bent, self._factors, k))


def law_along(rows: Any, coefficients: Any, law: Any, shaped: Any, sign: Any, pulsation: Any, stribeck: Any,
              factor: Any, sigma: Any, tanh: Any, sech: Any) -> Iterator[int]:
    """Fill the coefficients of mubar, and of Ts mubar with its derivatives, along a motion; staged function.

    The rules are those of series: dF = F d(-alpha |v|), dT = (1 - T^2) d(sigma v).

    Parameters
    ----------
    rows, coefficients : the motion's coefficients, and those of mubar
    law : (COLUMNS, 8 or 16) columns FRICTION to OF_SMOOTHING, and with 16 from OF_LATER on; only the first four are
        filled where `shaped` is None, with 0 by a_1 and sigma
    sign : of the slip speed
    stribeck, factor : amplitudes and rates in turn, and F = exp(-a |v|) of the first one; None where they do not vary
    sigma, tanh, sech : sigma, T = tanh(sigma v) and 1 - T^2; None where it does not vary
    """
    if stribeck is None and sigma is None:
        return
    decays, sharpens = (None, None) if shaped is None else (Causes({OF_DECAY: 1.0}), Causes({OF_SMOOTHING: 1.0}))
    weighted, t, s, side = [0.0], [tanh], [sech], Changing(sign)
    turned, fallen, load = ([] for _ in range(3))
    falls: list[Exponential] = []
    causes = range(OF_SLIP, OF_DECAY + 1 if shaped is None else law.shape[-1])
    later = shaped is not None and law.shape[-1] > NARROW
    rising: list[Any] = []
    mubar: list[Any] = []
    side_by_side: list[Any] = []
    if stribeck is not None:
        falls.append(Exponential(factor, Changing(stribeck[0], Causes({OF_EXCESS: 1.0})),
                                 Changing(stribeck[1], decays) * -side))
        for j, causes_of_pair in zip(range(2, len(stribeck), 2), COLUMNS_OF_PAIRS[1:]):
            share, rate = (Causes({cause: 1.0}) if later else None for cause in causes_of_pair)
            falls.append(Exponential(exp(-stribeck[j + 1] * sign * rows[SLIP, 0]), Changing(stribeck[j], share),
                                     Changing(stribeck[j + 1], rate) * -side))
    if sigma is not None:
        sharpness = Changing(sigma, sharpens)
    for k in range(FRICTION_ORDER_MAXIMUM):
        v = Changing(rows[SLIP, k], Causes({OF_SLIP: 1.0} if k == 0 else {}))
        if k > 0:
            weighted.append(float(k) * v.value)
        if sigma is None:
            rising.append(side if k == 0 else 0.0)
        else:
            if k > 0:
                hyperbolic(sigma, weighted, t, s, k)
            turned.append((v * sharpness).change)
            rising.append(Changing(t[k], product(turned, s, k)))
        mubar.append(rising[k])
        if stribeck is not None:
            fallen.append(added([one.share * one.following(v, weighted, k) for one in falls]))
            mubar[k] = mubar[k] + product(fallen, rising, k)
        load.append(rows[LOAD, k] if k == 0 or pulsation is not None else 0.0)
        coefficients[k,] = mubar[k].value
        side_by_side.append(row_of([mubar[k].value, *(mubar[k].change.get(cause, 0.0) for cause in causes)]))
        law.set_row(product(side_by_side, load, k), k)
        if shaped is None:
            law[k, OF_SMOOTHING] = 0.0
        if k % 2 == 1 and k >= 7:
            yield k + 1
