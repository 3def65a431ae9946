"""TGOSPA as a function of JAX, with its derivative: ``tgospa_eval.jax.tgospa``."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from tgospa_eval.api.evaluate import evaluate

Options = tuple[tuple[str, Any], ...]


def tgospa(truth: jax.Array, estimate: jax.Array, *, total: bool = False, **options: Any) -> Any:
    """TGOSPA of two arrays of states, differentiable by the estimate, also under ``jax.jit``.

    Parameters
    ----------
    truth, estimate : (T, m, d), (T, n, d) array
        States, NaN where an object is absent. Evaluated in double precision on the CPU.
    total : bool
        Whether to give the cost, TGOSPA to the power p, which is smooth where TGOSPA is 0.
    **options
        As for `tgospa_eval.evaluate`: ``cutoff``, ``order``, ``switch_penalty``, ``distance`` ...

    Returns
    -------
    Array
        A scalar of the type of the estimate. Its derivative is that of the best assignment,
        `Result.gradient`; absent states have the derivative 0. The truth is held.
    """
    return _tgospa(total, tuple(sorted(options.items())), truth, estimate)


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def _tgospa(total: bool, options: Options, truth: jax.Array, estimate: jax.Array) -> Any:
    return _with_slopes(total, options, truth, estimate)[0]


def _with_slopes(total: bool, options: Options, truth: jax.Array, estimate: jax.Array) -> Any:
    """Value, and derivative by the estimate, from outside of the traced computation."""
    scalar = jax.ShapeDtypeStruct((), estimate.dtype)
    slopes = jax.ShapeDtypeStruct(estimate.shape, estimate.dtype)

    def outside(*sides: Any) -> tuple[Any, Any]:
        whole, moved = (np.asarray(side, np.float64) for side in sides)
        result = evaluate(whole, moved, **dict(options))
        gradient = result.gradient()
        value = result.total if total else result.tgospa
        slope = gradient.array * (1.0 if total else gradient.root)
        return np.asarray(value, scalar.dtype), np.asarray(slope, slopes.dtype)

    return jax.pure_callback(outside, (scalar, slopes), truth, estimate)


def _backward(total: bool, options: Options, kept: Any, change: Any) -> Any:
    del total, options
    truth, slopes = kept
    return jnp.zeros_like(truth), change * slopes


_tgospa.defvjp(
    lambda total, options, truth, estimate: (
        (found := _with_slopes(total, options, truth, estimate))[0],
        (truth, found[1]),
    ),
    _backward,
)
